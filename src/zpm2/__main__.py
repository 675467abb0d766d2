"""`python -m zpm2`."""

from zpm2.cli import main

if __name__ == "__main__":
    main()
