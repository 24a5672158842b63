"""Exits with 0 while the manager in this container answers. A controller that does not is no fault of the manager: `/metrics` has it."""

import os
import ssl
import sys
from urllib.request import HTTPSHandler, ProxyHandler, build_opener

URL = "http://127.0.0.1:5003/healthz"
ANSWER_S = 4.0
"""Chosen: below the time limit of the check in the Containerfile, so that the reason is printed."""


def main() -> int:
    """Ask once."""
    # the certificate is for the name by which others know this manager
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    opener = build_opener(ProxyHandler({}), HTTPSHandler(context=context))
    try:
        with opener.open(os.environ.get("LIFT_MANAGER_HEALTH_URL", URL), timeout=ANSWER_S):
            return 0
    except (OSError, ValueError) as error:
        sys.stderr.write(f"the manager does not answer: {error}\n")
        return 1


sys.exit(main())
