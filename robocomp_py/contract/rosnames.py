"""Names as ROS demands: types are CamelCase, fields lower_snake_case, packages too."""

from __future__ import annotations

import keyword
import re


def package_of(module: str) -> str:
    """`RoboCompJointMotor` → `robocomp_joint_motor`."""
    return snake(re.sub(r"^RoboComp(?=.)", "Robocomp_", module))


def snake(name: str) -> str:
    """`maxSpeed` → `max_speed`, `RGBImage` → `rgb_image`."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    return re.sub("_+", "_", words).strip("_").lower()


def camel(name: str) -> str:
    """`left_motors` → `LeftMotors`."""
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[_\W]+", name))


def field_name(name: str) -> str:
    """`maxSpeed` → `max_speed`, `class` → `class_value`."""
    found = snake(name)
    return f"{found}_value" if found in _KEYWORDS else found


_KEYWORDS = {each.lower() for each in keyword.kwlist} | set(
    re.findall(
        r"\w+",
        """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl concept const constexpr
    const_cast continue decltype default delete do double dynamic_cast else enum explicit export extern false float for
    friend goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or or_eq private
    protected public register reinterpret_cast requires restrict return short signed sizeof static static_assert
    static_cast struct switch template this thread_local throw true try typedef typeid typename union unsigned using
    virtual void volatile wchar_t while xor xor_eq
    """,
    )
)
"""Keywords of C++ and Python, which cannot be members in the code that ROS generates."""
