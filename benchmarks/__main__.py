"""`python -m benchmarks`. The processes of the far ends import this module, too, so it is almost empty."""

if __name__ == "__main__":
    import sys

    from .command import main

    sys.exit(main())
