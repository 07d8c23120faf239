# Generated from patrol.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of patrol, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import (
    Component,
    Machine,
    PeriodicTimer,
    Port,
    State,
    StateMachine,
    Transition,
    Trigger,
    Verb,
    Worker,
)

from . import Shapes


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "patrol",
        ports=(
            Port(Verb.REQUIRES, Shapes.DRAWING_INTERFACE, proxy=Shapes.DrawingProxy),
        ),
        period=0.1,
        machine=StateMachine(
            "patrol",
            states=(
                State("waiting"),
                State(
                    "working",
                    states=(
                        State(
                            "moving",
                            states=(
                                State("driving"),
                                State("turning"),
                                State("arrived", final=True),
                            ),
                            initial="driving",
                        ),
                        State(
                            "watching",
                            states=(State("looking"),),
                            initial="looking",
                        ),
                    ),
                    parallel=True,
                ),
                State("charging"),
                State("broken"),
                State("off", final=True),
            ),
            initial="waiting",
            transitions=(
                Transition("waiting", "working"),
                Transition("waiting", "off"),
                Transition("working", "charging"),
                Transition("working", "broken"),
                Transition("charging", "waiting"),
                Transition("turning", "charging"),
                Transition("driving", "driving"),
                Transition("driving", "turning"),
                Transition("driving", "arrived"),
                Transition("turning", "driving"),
                Transition("looking", "looking"),
            ),
        ),
        timers=(
            PeriodicTimer("look", 0.02),
            PeriodicTimer("report", 60.0),
        ),
    )
    middleware = "auto"

    drawing_proxy: Shapes.DrawingProxy

    statemachine: Machine
    t_waiting_to_working: Trigger
    t_waiting_to_off: Trigger
    t_working_to_charging: Trigger
    t_working_to_broken: Trigger
    t_charging_to_waiting: Trigger
    t_turning_to_charging: Trigger
    t_driving_to_driving: Trigger
    t_driving_to_turning: Trigger
    t_driving_to_arrived: Trigger
    t_turning_to_driving: Trigger
    t_looking_to_looking: Trigger

    @abstractmethod
    def sm_waiting(self) -> None:
        """Called when `waiting` is entered. From here: self.t_waiting_to_working(),
        self.t_waiting_to_off().
        """

    @abstractmethod
    def sm_working(self) -> None:
        """Called when `working` is entered. From here: self.t_working_to_charging(),
        self.t_working_to_broken().
        """

    @abstractmethod
    def sm_moving(self) -> None:
        """Called when `moving` is entered."""

    @abstractmethod
    def sm_driving(self) -> None:
        """Called when `driving` is entered. From here: self.t_driving_to_driving(),
        self.t_driving_to_turning(), self.t_driving_to_arrived().
        """

    @abstractmethod
    def sm_turning(self) -> None:
        """Called when `turning` is entered. From here: self.t_turning_to_charging(),
        self.t_turning_to_driving().
        """

    @abstractmethod
    def sm_arrived(self) -> None:
        """Called when `arrived` is entered, which ends `moving`."""

    @abstractmethod
    def sm_watching(self) -> None:
        """Called when `watching` is entered."""

    @abstractmethod
    def sm_looking(self) -> None:
        """Called when `looking` is entered. From here: self.t_looking_to_looking()."""

    @abstractmethod
    def sm_charging(self) -> None:
        """Called when `charging` is entered. From here:
        self.t_charging_to_waiting().
        """

    @abstractmethod
    def sm_broken(self) -> None:
        """Called when `broken` is entered."""

    @abstractmethod
    def sm_off(self) -> None:
        """Called when `off` is entered, which ends the state machine."""

    @abstractmethod
    def timer_look(self) -> None:
        """Called every 20 ms."""

    @abstractmethod
    def timer_report(self) -> None:
        """Called every 60 s."""
