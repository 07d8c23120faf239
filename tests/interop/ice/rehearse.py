"""A program with Ice alone, which publishes and subscribes as the components that RoboComp generates do.

    rehearse.py publish TOPIC_MANAGER TOPIC      a reading again and again, numbered from 1
    rehearse.py subscribe TOPIC_MANAGER TOPIC    prints what it hears, a line of JSON each

Run in the folder with what slice2py made of Readings.ice.
"""

from __future__ import annotations

import json
import sys
import time

sys.path.insert(0, ".")

import Ice
import IceStorm
import RoboCompReadings as readings


class Listener(readings.Readings):
    def reading(self, what, number, current=None):
        trace = [[each.x, each.y] for each in what.trace]
        told = [what.name, str(what.quality), trace, list(what.raw), what.counts, what.heard, number]
        print(json.dumps(told), flush=True)

    def silence(self, current=None):
        print(json.dumps("silence"), flush=True)


def topic_of(manager, name):
    try:
        return manager.retrieve(name)
    except IceStorm.NoSuchTopic:
        try:
            return manager.create(name)
        except IceStorm.TopicExists:
            return manager.retrieve(name)


def main(act, manager_proxy, name):
    with Ice.initialize() as communicator:
        manager = IceStorm.TopicManagerPrx.checkedCast(communicator.stringToProxy(manager_proxy))
        topic = topic_of(manager, name)
        if act == "subscribe":
            adapter = communicator.createObjectAdapterWithEndpoints("ReadingsTopic", "tcp -h 127.0.0.1")
            topic.subscribeAndGetPublisher({}, adapter.addWithUUID(Listener()).ice_oneway())
            adapter.activate()
            communicator.waitForShutdown()
        proxy = readings.ReadingsPrx.uncheckedCast(topic.getPublisher().ice_oneway())
        trace = [readings.Point(1.5, -2.25), readings.Point(0.0, 1e-9)]
        what = readings.Reading("Mauer", readings.Quality.good, trace, b"\0\xff", {"doors": 2}, 2**40 + 1)
        number = 0
        while True:
            number += 1
            try:
                proxy.silence()
                proxy.reading(what, number)
            except Ice.LocalException as exc:
                print(type(exc).__name__, flush=True)
            time.sleep(0.02)


main(*sys.argv[1:])
