import sys

import Ice
import RoboCompSonar

with Ice.initialize() as communicator:
    sonar = RoboCompSonar.SonarPrx.checkedCast(communicator.stringToProxy(sys.argv[1]))
    echoes, reach = sonar.scan(2)
    print([echo.distance for echo in echoes], echoes[0].quality, reach)
    try:
        sonar.scan(1000)
    except RoboCompSonar.OutOfRange as exc:
        print("out of range:", exc.limit)
