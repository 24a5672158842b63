# shellcheck shell=sh
# What ./scripts/demo and ./scripts/test share: one environment in .venv, made when it is missing or out of date.
# Expects $root, the folder of the repository.

venv=$root/.venv
python=$venv/bin/python

# What others put there (ROS does) would be imported before what is installed here.
unset PYTHONPATH PYTHONHOME

stop() {
    echo "$*" >&2
    exit 1
}

# Sets $base, the interpreter to build with, and $version.
find_python() {
    if [ -n "${LIFT_MANAGER_PYTHON:-}" ]; then
        set -- "$LIFT_MANAGER_PYTHON"
    else
        set -- python3 python3.14 python3.13 python3.12 python3.11
    fi
    old=
    for base in "$@"; do
        version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || continue
        case $version in
            3.[0-9] | 3.10 | [!3]*) old="$old $base is $version," ;;
            *) return ;;
        esac
    done
    old=${old:-" found no $*,"}
    stop "The lift manager needs Python 3.11 or newer, but${old%,}: apt-get install python3 python3-venv" \
        "(Debian 12 or newer), or name another one in LIFT_MANAGER_PYTHON."
}

make_venv() {
    if ! "$base" -c 'import ensurepip, venv' 2>/dev/null; then
        name=${base##*/}
        case $name in python3*) ;; *) name=python3 ;; esac
        stop "$base cannot make a virtual environment, its venv module is not installed: apt-get install $name-venv"
    fi
    "$base" -m venv --clear "$venv" || stop "$base could not make $venv"
}

# A venv made by hand, or for older versions of what it holds, is brought up to date; anything doubtful is made anew.
venv_is_sound() {
    [ ! -e "$venv/installing" ] &&
        grep -qsF "$python" "$venv/bin/pip" && # false in a copied or moved folder: its commands run the original
        [ "$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$version" ]
}

# prepare demo: what the program needs. prepare test: that, and what the tests need.
prepare() {
    find_python
    hash=$("$base" -c 'import hashlib, sys; print(hashlib.sha256(b"".join(open(path, "rb").read() for path in sys.argv[1:])).hexdigest())' \
        "$root/pyproject.toml" "$root/constraints/run.txt" "$root/constraints/dev.txt") ||
        stop "pyproject.toml or the files in constraints/ cannot be read"
    is_ready "$1" && return

    # Two first starts at the same time must not install over each other.
    exec 9<"$root/pyproject.toml"
    if command -v flock >/dev/null; then flock 9; fi
    if ! is_ready "$1"; then install "$1"; fi
    exec 9<&-
}

pip_install() {
    "$python" -m pip install --quiet --disable-pip-version-check --no-input "$@" ||
        stop "Installing failed, see above; the next start tries again."
}

is_ready() {
    for kind in "$1" test; do
        [ "$(cat "$venv/stamp" 2>/dev/null)" = "$(stamp "$kind")" ] && return
    done
    return 1
}

stamp() {
    echo "$1 $version $hash $root"
}

install() {
    echo "Installing into .venv (first start, about a minute) ..." >&2
    # a test environment stays one
    case $1$(cat "$venv/stamp" 2>/dev/null) in *test*) kind=test needs=dev ;; *) kind=demo needs=run ;; esac
    venv_is_sound || make_venv
    rm -f "$venv/stamp"
    : >"$venv/installing"
    # In two steps, because a folder has no hash. The second one needs nothing but the setuptools of the first.
    pip_install --require-hashes --requirement "$root/constraints/$needs.txt"
    pip_install --no-deps --no-build-isolation --editable "$root"
    stamp "$kind" >"$venv/stamp"
    rm "$venv/installing"
}
