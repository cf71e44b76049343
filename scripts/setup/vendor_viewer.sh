#!/bin/sh
# The web viewer that `dogsplat export -o model.html` puts into pages: SuperSplat Viewer with the PlayCanvas engine
# inside, both MIT, from npm. Writes viewer.js.gz, viewer.css, LICENSE and VERSION into
# mi_dogsplat/export/vendor/supersplat_viewer/.
# To move to another version change it here, run `make web-viewer`, and look at a page. Needs node and npm.
set -eu
VERSION=1.36.2
ESBUILD=0.28.2
target=$(cd "$(dirname "$0")/../.." && pwd)/mi_dogsplat/export/vendor/supersplat_viewer
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund "esbuild@$ESBUILD"
npm pack --silent "@playcanvas/supersplat-viewer@$VERSION" > /dev/null
tar xzf playcanvas-supersplat-viewer-"$VERSION".tgz
echo 'export { createViewer } from "./package/public/index.js";' > entry.js
# A classic script that defines splatViewer: modules cannot be loaded from a file on disk. Its workers ask for
# node:worker_threads only outside of browsers.
npx esbuild entry.js --bundle --minify --format=iife --global-name=splatViewer --external:node:worker_threads \
    --log-level=error --outfile=viewer.js
npx esbuild package/public/index.css --minify --log-level=error --outfile=viewer.css
if grep -q '</script' viewer.js viewer.css; then
    echo "the viewer contains </script, which would end it early in a page" >&2
    exit 1
fi
mkdir -p "$target"
gzip -9nc viewer.js > "$target/viewer.js.gz"
cp viewer.css package/LICENSE "$target/"
engine=$(sed -n 's/.*"playcanvas": "\([0-9][0-9.]*\)".*/\1/p' package/package.json | tail -n 1)
echo "@playcanvas/supersplat-viewer $VERSION, playcanvas $engine" > "$target/VERSION"
ls -l "$target"
