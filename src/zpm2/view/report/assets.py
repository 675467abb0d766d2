"""A page from a template, a style sheet and ES modules, put into one HTML file that needs nothing else.

The modules import each other as `#report/NAME.js`. Node finds these by the folder's package.json, a browser by the
import map of the page, which holds the modules themselves as data URLs: no bundler is needed, and pages opened from
disk work.
"""

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from importlib import resources

import cv2
import jinja2
import numpy as np
from numpy.typing import NDArray

PAGE = resources.files("zpm2.view.report").joinpath("page")
PREFIX = "#report/"
IMPORTED = re.compile(rf'from "{PREFIX}([a-z]+\.js)"')
QUALITY = 85  # 1..100, of the pictures (WebP)


def render(template: str, main: str, data: Mapping[str, object], **values: object) -> str:
    """The HTML of a template of the folder `page`.

    main: the module that starts. data: for the page's script, as JSON. values: for the template.
    """
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_text),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    imports = json.dumps({"imports": {PREFIX + name: _url(name) for name in _modules(main)}})
    start = f'import "{PREFIX}{main}";'
    return environment.get_template(template).render(
        style=_text("report.css"),
        imports=imports,
        start=start,
        hashes=" ".join(f"'sha256-{_sha256(script)}'" for script in (imports, start)),
        data=in_script(data),
        **values,
    )


def in_script(value: object) -> str:
    """JSON for the inside of a `script` element: no text in it can end the element or open another one."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def data_url(kind: str, content: bytes) -> str:
    """A file as an address."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def picture_url(picture: NDArray[np.uint8]) -> str:
    """(h, w, 3 or 4) RGB or RGBA as an address."""
    order = cv2.COLOR_RGB2BGR if picture.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
    _, packed = cv2.imencode(".webp", cv2.cvtColor(picture, order), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    return data_url("image/webp", packed.tobytes())


def _modules(main: str) -> list[str]:
    """The names of a module and of all that it needs, sorted."""
    found, left = set[str](), [main]
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += IMPORTED.findall(_text(name))
    return sorted(found)


def _text(name: str) -> str:
    return PAGE.joinpath(name).read_text(encoding="utf-8")


def _url(name: str) -> str:
    return data_url("text/javascript", _text(name).encode())


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
