"""Shipped for tests of components and of transports."""

import sys

if "pytest" in sys.modules:  # so that failed assertions in the suites show values, like those of any test
    sys.modules["pytest"].register_assert_rewrite(f"{__name__}.conformance")
