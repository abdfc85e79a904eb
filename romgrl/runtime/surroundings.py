"""What a command makes of an environment that was set for other programs, before anything reads it.

Processes that it starts inherit the result.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import MutableMapping
from urllib.parse import urlsplit
from urllib.request import getproxies_environment, proxy_bypass

LOOPBACK = ("localhost", "127.0.0.1", "::1")


def adapt_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Keep out what would stop a command and says nothing about it: warnings as errors, windows, proxies to itself."""
    if "error" in environment.get("PYTHONWARNINGS", ""):
        del environment["PYTHONWARNINGS"]  # a library that warns would end the work
        kept = [each for each in warnings.filters if each[0] != "error"]
        warnings.resetwarnings()
        warnings.filters[:] = kept  # type: ignore[index]  # a list, and the rest of them hides as before
    environment["MPLBACKEND"] = "agg"  # figures are files; an unknown name would end the import of Matplotlib
    names = {name.lower() for name, value in environment.items() if value}
    if names & {"http_proxy", "https_proxy", "all_proxy"}:
        left_out = environment.get("no_proxy") or environment.get("NO_PROXY") or ""
        missing = [host for host in LOOPBACK if host not in left_out.split(",")] if left_out.strip() != "*" else []
        environment["no_proxy"] = environment["NO_PROXY"] = ",".join([*filter(None, [left_out]), *missing])


def proxy_note(uri: str) -> str:
    """What to add to the failure of a server that is asked through a proxy; nothing where it is asked directly.

    The proxy is the one that urllib and requests take from the environment.
    """
    try:
        parts = urlsplit(uri)
        host = parts.hostname or ""
    except ValueError:
        return ""
    proxies = getproxies_environment()
    scheme = parts.scheme if parts.scheme in proxies else "all"
    if parts.scheme not in ("http", "https") or scheme not in proxies or proxy_bypass(host):
        return ""
    names = [name for name in os.environ if name.lower() == f"{scheme}_proxy" and os.environ[name] == proxies[scheme]]
    variable = names[0] if names else f"{scheme}_proxy"
    proxy = proxies[scheme].rpartition("://")[2].rpartition("@")[2]  # without its password
    return f"; {host} is asked through the proxy {proxy} of {variable}; NO_PROXY={host} leaves it out"
