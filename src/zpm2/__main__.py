"""`python -m zpm2`."""

from zpm2.cli.app import main

if __name__ == "__main__":
    main()
