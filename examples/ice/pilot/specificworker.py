from .generic.genericworker import GenericWorker
from .generic.RoboCompSonar import OutOfRange


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        echoes, reach = self.sonar_proxy.scan(3)
        print([echo.distance for echo in echoes], echoes[0].quality.name, reach)
        try:
            self.sonar_proxy.scan(1000)
        except OutOfRange as exc:
            print("out of range:", exc.limit)
        self.stop()

    def compute(self) -> None: ...
