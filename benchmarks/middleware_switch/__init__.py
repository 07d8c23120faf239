"""The same component over every middleware: its own code keeps its bytes, and only what is generated changes.

A component with the Speech interface of A. Romero-Garcés, L. J. Manso, M. A. Gutiérrez, R. Cintas and P. Bustos:
Improving the Lifecycle of Robotics Components using Domain-Specific Languages, DSLRob 2012 (arXiv:1301.6022), and a
client that asks it again and again. Both are generated for one middleware after the other, run, and at last generated
for the first one once more.

    python -m benchmarks.middleware_switch
"""
