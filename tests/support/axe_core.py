"""axe-core (`axe/`, version 4.14.1, as npm has it, MPL-2.0): finds what keeps people from using a page.

The file is here, unmodified, so that the ordinary run needs neither Node.js nor a network.
"""

from pathlib import Path

from tests.support.devtools import Tab

FILE = Path(__file__).with_name("axe") / "axe.min.js"
SERIOUS = {"serious", "critical"}


async def problems(tab: Tab) -> list[str]:
    """Return what is seriously wrong with what the tab shows: the rule, and the elements."""
    # the Content-Security-Policy of the page is not that of what DevTools evaluate, so it stays on
    await tab.value(f"{FILE.read_text('utf-8')}; null")
    found = await tab.value("axe.run(document, {resultTypes: ['violations']}).then((found) => found.violations)")
    return [
        f"{rule['id']}: {rule['help']}: {[node['html'][:200] for node in rule['nodes']][:3]}"
        for rule in found
        if rule["impact"] in SERIOUS
    ]
