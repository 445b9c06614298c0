"""The application: `uvicorn server.app:app`. SWARMBENCH_TASK and SWARMBENCH_MODE choose the games."""

import os

from swarmseat.openenv import app as make_app
from swarmseat.openenv import main

app = make_app(task=os.environ.get("SWARMBENCH_TASK", "Foraging"), mode=os.environ.get("SWARMBENCH_MODE", "one_seat"))

if __name__ == "__main__":
    main()
