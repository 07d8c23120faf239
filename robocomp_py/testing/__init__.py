"""Shipped for tests of components and of transports."""

import sys

if "pytest" in sys.modules:  # then the assertions of the suite show values when they fail, as those of any test do
    sys.modules["pytest"].register_assert_rewrite(f"{__name__}.conformance")
