"""A program of RoboComp's kind: serves a gauge, or asks for a report. Imports Ice and what slice2py made, nothing else.

python gauge.py FOLDER serve PORT       FOLDER is where slice2py wrote to
python gauge.py FOLDER ask PROXY
"""

import contextlib
import sys

import Ice

sys.path.insert(0, sys.argv[1])
import RoboCompGauge as gauge


class Gauge(gauge.Gauge):
    def read(self, number, current=None):
        if number < 0:
            raise gauge.Broken(why=f"there is no {number}")
        return gauge.Reading(value=number / 2, raw=[number] * 3)


def serve(communicator, port):
    adapter = communicator.createObjectAdapterWithEndpoints("Gauge", f"tcp -h localhost -p {port}")
    adapter.add(Gauge(), communicator.stringToIdentity("gauge"))
    adapter.activate()
    print("serving", flush=True)
    communicator.waitForShutdown()


def ask(communicator, proxy):
    report = gauge.ReportPrx.uncheckedCast(communicator.stringToProxy(proxy)).ice_invocationTimeout(20000)
    for number in (7, -1):
        try:
            print("told", report.tell(number), flush=True)
        except gauge.Broken as exc:
            print("broken:", exc.why, flush=True)


with Ice.initialize() as here, contextlib.suppress(KeyboardInterrupt):
    {"serve": serve, "ask": ask}[sys.argv[2]](here, sys.argv[3])
