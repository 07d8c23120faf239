"""`python -m benchmarks.check`. The far ends are processes that import this again, so there is next to nothing here."""

if __name__ == "__main__":
    import sys

    from .guard import main

    sys.exit(main())
