#!/usr/bin/env bash
# Makes camgen/preview/web/three.min.js anew: what the page uses of three.js, in one file. Needs npm.
set -euo pipefail
version=0.187.0
web=$(cd "$(dirname "$0")/../../camgen/preview/web" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$web/three_used.js" "$work"
cd "$work"
npm install --silent --no-save --no-package-lock "three@$version" esbuild@0.28.2
npx esbuild three_used.js --bundle --minify --format=iife --global-name=THREE --legal-comments=none --target=es2020 \
    --charset=ascii --log-level=error --outfile=bundle.js
cp node_modules/three/LICENSE "$web/three.LICENSE"
{
    echo "/*! three.js $version, only what the page uses"
    echo
    cat "$web/three.LICENSE"
    echo "*/"
    cat bundle.js
} >"$web/three.min.js"
