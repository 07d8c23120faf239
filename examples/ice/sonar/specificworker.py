from .generic.genericworker import GenericWorker
from .generic.RoboCompSonar import Echo, OutOfRange, Quality


class SpecificWorker(GenericWorker):
    def Sonar_scan(self, directions: int) -> tuple[list[Echo], float]:
        if directions > 360:
            raise OutOfRange(360.0)
        return [Echo(1.5, Quality.good)] * directions, 4.0
