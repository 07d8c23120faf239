import sys

import Ice
import RoboCompSonar


class Sonar(RoboCompSonar.Sonar):
    def scan(self, directions, current=None):
        if directions > 100:
            raise RoboCompSonar.OutOfRange(100.0)
        return [RoboCompSonar.Echo(0.5, RoboCompSonar.Quality.bad)] * directions, 1.0


with Ice.initialize() as communicator:
    adapter = communicator.createObjectAdapterWithEndpoints("Sonar", sys.argv[1])
    adapter.add(Sonar(), Ice.stringToIdentity("sonar"))
    adapter.activate()
    print("ready", flush=True)
    communicator.waitForShutdown()
