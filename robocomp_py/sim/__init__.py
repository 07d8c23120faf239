"""A scene of InnerModel, simulated on MuJoCo. Needs the extra `[sim]`.

world = World(Tree.read("house.xml"), seed=1)
world.drive("base", ahead=200.0)
world.step(100)
world.scan("laser")
"""
