"""What the languages save: five tasks of a component's developer, each done twice from the same start.

With the languages, a model is edited and the generic part generated again. By hand, on the same project without its
generator, the generic part is edited as well: the smallest change that a careful programmer would make, typed like
what is around it. Either way the same test of behaviour has to pass. The tasks are those of A. Romero-Garcés,
L. J. Manso, M. A. Gutiérrez, R. Cintas and P. Bustos: Improving the Lifecycle of Robotics Components using
Domain-Specific Languages, DSLRob 2012 (arXiv:1301.6022).

    python -m benchmarks.dsl_tasks

Lines written and files touched are counted, and the generator is timed. How long people take is not measured.
"""
