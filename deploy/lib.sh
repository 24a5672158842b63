# shellcheck shell=sh
# What the commands in deploy/ share. Expects $root, the folder of the repository. Everything they make goes to dist/.

. "$root/scripts/lib.sh"

dist=$root/dist
number=$(sed -n 's/^version = "\(.*\)"$/\1/p' "$root/pyproject.toml") # of the program

# Makes $work, a folder that goes away with the command, and $tools, the interpreter of an environment for building.
prepare_tools() {
    find_python
    mkdir -p "$dist"
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    trap 'exit 130' INT
    trap 'exit 143' TERM
    "$base" -m venv "$work/tools" || stop "$base could not make a virtual environment: apt-get install python3-venv"
    tools=$work/tools/bin/python
    pip install --require-hashes --requirement "$root/constraints/package.txt"
}

pip() {
    "$tools" -m pip --quiet --disable-pip-version-check --no-input "$@" || return 1
}

# build_wheel FOLDER: the manager itself, from a copy, so that nothing is left in the repository.
build_wheel() {
    mkdir -p "$work/source"
    (cd "$root" && cp -r pyproject.toml README.md LICENSE MANIFEST.in lift_manager drivers register_maps simulator "$work/source")
    find "$work/source" -name __pycache__ -prune -exec rm -rf {} +
    pip wheel --no-deps --no-build-isolation --wheel-dir "$1" "$work/source" || stop "The wheel could not be built, see above."
    rm -rf "$work/source"
}

# collect_wheels FOLDER MACHINE VERSION: everything that is installed on a machine (x86_64, aarch64) with a version of Python, and
# requirements.txt, which names each file by its hash. With the hub, and with Open-RMF over DDS where there is a wheel for it.
collect_wheels() {
    build_wheel "$1"
    options="--only-binary=:all: --implementation cp --python-version $3 --abi cp$(echo "$3" | tr -d .) --abi abi3 --abi none"
    for glibc in 2_17 2_24 2_26 2_27 2_28 2_31 2_34 2_35; do options="$options --platform manylinux_${glibc}_$2"; done
    options="$options --platform manylinux2014_$2"
    needs=rmf
    # shellcheck disable=SC2086  options are words
    if ! pip download --no-deps --require-hashes --requirement "$root/constraints/rmf.txt" --dest "$1" $options 2>"$work/why"; then
        needs=hub
        pip download --no-deps --require-hashes --requirement "$root/constraints/hub.txt" --dest "$1" $options ||
            stop "The wheels for $2 and Python $3 could not be fetched, see above."
        echo "Open-RMF over DDS is not in it: cyclonedds has no wheel for $2 and Python $3 ($(grep -v '^WARNING' "$work/why" | head -1))." \
            "Run \`lift-manager rmf\` on another computer beside this manager, or the ROS package of deploy/ros." >&2
    fi
    cp "$root/constraints/$needs.txt" "$1/requirements.txt"
}

# sbom PYTHON FILE: what is installed in an environment, as CycloneDX.
sbom() {
    "$work/tools/bin/cyclonedx-py" environment --pyproject "$root/pyproject.toml" --mc-type application --output-reproducible \
        --spec-version 1.6 --output-format JSON --output-file "$2" "$1"
}

# ride_demo COMMAND...: starts the demo with this command, rides its first lift, and ends the demo. Needs $work.
ride_demo() {
    : >"$work/demo"
    "$@" demo --port 0 --speed 10 >"$work/demo" 2>&1 &
    demo=$!
    trap 'kill $demo 2>/dev/null; rm -rf "$work"' EXIT
    waited=0
    until address=$(grep -o 'http://127\.0\.0\.1:[0-9]*' "$work/demo" | head -1) && [ -n "$address" ]; do
        kill -0 $demo 2>/dev/null && [ $waited -lt 120 ] || { cat "$work/demo" >&2 && stop "The demo did not start, see above."; }
        sleep 1
        waited=$((waited + 1))
    done
    "$@" ride lift L1 L2 --robot "$(basename "$0")" --yes --manager "$address" || { cat "$work/demo" >&2 && stop "The ride failed, see above."; }
    kill $demo
    wait $demo || stop "The demo did not end in order."
    trap 'rm -rf "$work"' EXIT
}
