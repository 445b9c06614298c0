"""`python -m swarmseat …`: the `swarmbench` program of this installation."""

import os
import sys

from .errors import ServerError
from .server import find_binary


def main() -> None:
    """Replaces this process by the program."""
    try:
        program = find_binary()
    except ServerError as error:
        sys.exit(f"error: {error}")
    os.execv(program, [str(program), *sys.argv[1:]])  # noqa: S606 - that is the purpose


if __name__ == "__main__":
    main()
