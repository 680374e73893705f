"""``python -m mottrack`` is the same as ``mottrack``."""

from mottrack.cli import main

if __name__ == "__main__":
    main()
