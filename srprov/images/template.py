"""The Dockerfile that a CDF with `base` becomes, as a template. Pure; what goes in is quoted by who renders it."""

from __future__ import annotations

from functools import cache

import jinja2

# `at(field)` marks where the lines of a field of the CDF begin; the marks are taken out again for the line map.
_TEMPLATE = """\
{% macro install(packages) -%}
apt-get -o Acquire::Retries=3 update \\
 && DEBIAN_FRONTEND=noninteractive apt-get -o Acquire::Retries=3 install -y --no-install-recommends {{ packages }} \\
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/archives/*.deb
{%- endmacro -%}
{{ at("base") }}FROM {{ base }}
{% if apt %}
{{ at("packages.apt") }}RUN {{ install(apt) }}
{% endif %}
{% if pip %}
{{ at("packages.pip") }}RUN { python3 -m pip -V >/dev/null 2>&1 || { {{ install("python3 python3-pip") }}; }; } \\
 && PIP_BREAK_SYSTEM_PACKAGES=1 PIP_ROOT_USER_ACTION=ignore PIP_DISABLE_PIP_VERSION_CHECK=1 \\
    python3 -m pip install --no-cache-dir {{ pip }}
{% endif %}
{% if npm %}
{{ at("packages.npm") }}RUN { command -v npm >/dev/null 2>&1 || { {{ install("nodejs npm") }}; }; } \\
 && npm install --global --prefix /usr/local --no-fund --no-audit {{ npm }} \\
 && npm cache clean --force
{% if "NODE_PATH" not in own_variables %}
ENV NODE_PATH="/usr/local/lib/node_modules"
{% endif %}
{% endif %}
{% if environment %}
{{ at("environment") }}ENV {{ environment | join(" \\\\\\n    ") }}
{% endif %}
{% if working_dir %}
{{ at("working_dir") }}WORKDIR {{ working_dir }}
{% endif %}
{% for one in repositories %}
{% set place = "repositories." ~ loop.index0 %}
{{ at(place) }}# commit {{ one.commit }} of {{ one.url }}
COPY {{ one.words }}
{% for script in one.run %}
{{ at(place ~ ".run." ~ loop.index0) }}RUN {{ script }}
{% endfor %}
{% endfor %}
{% for copy in files %}
{{ at("files." ~ loop.index0) }}COPY {{ copy }}
{% endfor %}
{% for script in run %}
{{ at("run." ~ loop.index0) }}RUN {{ script }}
{% endfor %}
{% if user %}
{{ at("user") }}USER {{ user }}
{% endif %}
{% if stop_signal %}
{{ at("stop_signal") }}STOPSIGNAL {{ stop_signal }}
{% endif %}
{% if entrypoint %}
{{ at("entrypoint") }}ENTRYPOINT {{ entrypoint }}
{% endif %}
{% if command %}
{{ at("command") }}CMD {{ command }}
{% endif %}
{{ at("name") }}{{ label }}
"""


@cache
def template() -> jinja2.Template:
    """Return the template, compiled once."""
    environment = jinja2.Environment(  # noqa: S701 - no HTML; values come in escaped for Dockerfiles
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(_TEMPLATE)
