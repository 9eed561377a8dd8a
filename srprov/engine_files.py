"""Shell scripts that read an image's layers from the files of a classic engine, without `docker save`. Text only.

`docker save` writes the whole image to the engine's disk, whatever is wanted of it. The files are those of Docker with
the driver overlay2: below `image/overlay2/layerdb/sha256/CHAIN` the layer's diff id, the name of its folder, and
`tar-split.json.gz`, which has all of the layer's tar but the contents of files; those are in `overlay2/NAME/diff`.
"""

from __future__ import annotations

from srprov.spool import own_folder
from srprov.wire import quote

DRIVER = "overlay2"


def config_script(root: str, image_id: str) -> str:
    """Return what prints an image's configuration from below the engine's root folder."""
    return f"exec cat < {quote(f'{root}/image/{DRIVER}/imagedb/content/sha256/{_digits(image_id)}')}"


def layer_script(root: str, chain_id: str, diff_id: str) -> str:
    """Return what gives a layer: its tar-split file, then contents of its files, as a tar in the order of a list.

    It says `has BYTES`, or `no REASON`; takes the line `go` and prints these bytes; takes the line `BYTES raw` or
    `BYTES gzip` and a list of so many bytes, its names ended by NUL; then prints the tar. tar neither opens what is no
    file nor follows a link that a name ends with, so that no layer can make it open a device of the robot.

    The list lies where only root may enter: who may write to /tmp would put a link in its place, and root would write
    names that an image has into any file of the robot.
    """
    store = quote(f"{root}/image/{DRIVER}/layerdb/sha256/{_digits(chain_id)}")
    return f"""{{
{own_folder()}
id=$(cat {store}/cache-id) && [ "$(cat {store}/diff)" = {quote(diff_id)} ] &&
  size=$(stat -c %s {store}/tar-split.json.gz) && cd {quote(root)}/{DRIVER}/"$id"/diff ||
  {{ echo "no layer of that name in its engine's files"; exit 1; }}
tar --version | grep -q GNU || {{ echo "no GNU tar"; exit 1; }}
# another shell that ends may have taken the empty folder above away meanwhile
mkdir -p "$spool" 2>/dev/null || mkdir -p "$spool" || {{ echo "no place for a list of files"; exit 1; }}
list=$spool/list
echo "has $size"
read -r go && [ "$go" = go ] && cat {store}/tar-split.json.gz || exit 1
read -r size way && head -c "$size" > "$list" && exec < "$list" || exit 1
contents() {{
  tar -c --no-recursion --hard-dereference --null -T - --format=posix --mtime=@0 --owner=0 --group=0 \\
    --numeric-owner --pax-option=delete=atime,delete=ctime
}}
if [ "$way" = raw ]; then contents; else contents | gzip -1 -n; fi
}}"""


def _digits(digest: str) -> str:
    return digest.removeprefix("sha256:")
