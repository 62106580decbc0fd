#!/usr/bin/env bash
# Proves that the suite sets itself up on a fresh Debian: makes a minimal system with debootstrap, copies the suite
# in, and runs there what a newcomer runs. Needs root, debootstrap and about 6 GB; takes its packages from $MIRROR.
#
# All mounts live in a mount namespace of their own and all processes in a process namespace: both end with this
# script, however it ends. The folder is removed afterwards unless --keep is given, and only from outside of that
# namespace, after a look whether anything is mounted below it.
# shellcheck disable=SC2015,SC2317  # "|| true" after a chain of steps is meant; functions called by trap and by step
set -euo pipefail

usage() {
  cat <<END
usage: test/clean_chroot.sh [--release bookworm] [--working-tree] [--keep] [--targets "check demo"] [FOLDER]
  --release       of Debian, bookworm or trixie (default: bookworm)
  --working-tree  copy the files as they are now, not the last commit
  --keep          leave FOLDER behind
  --targets       what to make, in this order (default: "check demo")
  FOLDER          absent or empty; default: a new one below \${TMPDIR:-/tmp}
MIRROR, if set, is where Debian comes from; otherwise debootstrap's own default.
END
}

fail() {
  echo "clean_chroot: $*" >&2
  exit 1
}

# in_chroot ROOT USER COMMAND...: with nothing of this environment; a newcomer has none of it.
in_chroot() {
  local root=$1 user=$2
  shift 2
  env -i HOME=/root USER="$user" TERM="${TERM:-dumb}" PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    chroot --userspec="$user:" "$root" "$@" </dev/null
}

results=()
failed=0

# step NAME COMMAND...: runs it and records the outcome and the time.
step() {
  local name=$1 start=$SECONDS status=0
  shift
  printf '\n=== %s\n' "$name"
  "$@" || status=$?
  [ "$status" = 0 ] || failed=1
  results+=("$(printf '%-58s %-9s %5d s' "$name" "$([ "$status" = 0 ] && echo passed || echo "FAILED $status")" \
    $((SECONDS - start)))")
  return "$status"
}

# Without the right to install anything, the suite has to name the command and touch nothing.
names_the_missing_packages() {
  local output
  if output=$(in_chroot "$1" nobody make -C /root/pi_edge build 2>&1); then
    echo "make build succeeded although packages are missing and the user may not install them"
    return 1
  fi
  echo "$output"
  grep -q '^ *apt-get update && apt-get install .*cmake' <<<"$output"
}

second_run_within_seconds() {
  local start=$SECONDS
  in_chroot "$1" root make -C /root/pi_edge build || return
  [ $((SECONDS - start)) -le 10 ]
}

# The part inside the namespaces.
inside() {
  local root=$1 targets=$2 target
  mount --bind "$root" "$root"    # "/" inside is then a mount, as on a real system, and namespaces can be made
  mount -t proc proc "$root/proc"
  mount -t sysfs -o ro sysfs "$root/sys"
  mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
  mkdir -p "$root/dev/shm"
  mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"

  step 'apt-get install make' in_chroot "$root" root \
    sh -c 'apt-get -q update && DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends make' &&
    step 'without root: names the packages to install' names_the_missing_packages "$root" &&
    step 'make build' in_chroot "$root" root make -C /root/pi_edge build &&
    step 'make build again, nothing changed, at most 10 s' second_run_within_seconds "$root" &&
    for target in $targets; do
      step "make $target" in_chroot "$root" root make -C /root/pi_edge "$target" || true
    done || true

  printf '\n'
  printf '%s\n' "${results[@]}"
  printf 'Size of the system with the suite built: %s\n' "$(du -xsh "$root" | cut -f1)"
  return "$failed"
}

# remove_system ROOT: only where nothing is mounted below; otherwise it stays and is named.
remove_system() {
  if awk -v root="$1/" 'index($5 "/", root) == 1 { found = 1 } END { exit !found }' /proc/self/mountinfo; then
    fail "something is mounted below $1, so it stays: unmount it, then remove the folder"
  fi
  rm -rf --one-file-system -- "$1"
}

copy_suite() {
  local top=$1 target=$2 which=$3
  mkdir -p "$target"
  if [ "$which" = working-tree ]; then
    "$top/scripts/copy_suite" "$target"
  else
    git -C "$top" archive HEAD | tar -x --no-same-owner -C "$target"
  fi
}

if [ "${1-}" = --inside ]; then
  inside "$2" "$3"
  exit
fi

release=bookworm which=HEAD keep=no targets='check demo' root=
while [ $# -gt 0 ]; do
  case $1 in
    --release) release=${2?--release needs a value}; shift ;;
    --working-tree) which=working-tree ;;
    --keep) keep=yes ;;
    --targets) targets=${2?--targets needs a value}; shift ;;
    -h | --help) usage; exit 0 ;;
    -*) usage >&2; fail "unknown option $1" ;;
    *) [ -z "$root" ] || fail "one FOLDER at most, got $root and $1"; root=$1 ;;
  esac
  shift
done

case $release in
  bookworm | trixie) ;;
  *) fail "--release $release: must be bookworm or trixie" ;;
esac
[ "$(id -u)" = 0 ] || fail 'needs root, to make a system and to mount inside it: run it with sudo'
command -v debootstrap >/dev/null || fail 'debootstrap is missing: apt-get install debootstrap'
top=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
if [ -z "$root" ]; then
  root=$(mktemp -d "${TMPDIR:-/tmp}/clean_chroot.XXXXXX")
else
  mkdir -p -- "$root"
  [ -z "$(ls -A -- "$root")" ] || fail "$root is not empty: name an absent or empty folder"
fi
root=$(cd -- "$root" && pwd -P)

child=
finish() {
  trap '' INT TERM HUP
  # The first process of the namespace takes all others with it, and its parent hears of it when the last has gone.
  if [ -n "$child" ]; then
    # shellcheck disable=SC2046  # one or no word
    kill -KILL $(cat "/proc/$child/task/$child/children" 2>/dev/null) 2>/dev/null || kill "$child" 2>/dev/null || true
    wait "$child" || true
  fi
  if [ "$keep" = yes ]; then
    echo "Left behind: $root"
  else
    remove_system "$root"
  fi
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

echo "Debian $release (minbase) into $root"
if ! debootstrap --variant=minbase "$release" "$root" ${MIRROR:+"$MIRROR"} >"$root.log" 2>&1; then
  tail -n 20 "$root.log" >&2
  fail "debootstrap failed; the whole log is $root.log"
fi
rm -f "$root.log"
echo '127.0.0.1 localhost' >"$root/etc/hosts"    # Debian's installer writes it, debootstrap does not
copy_suite "$top" "$root/root/pi_edge" "$which"
chmod 755 "$root" "$root/root"                   # for the step without root

# In the background, as bash serves a trap only after the foreground command has ended.
unshare --mount --propagation private --pid --fork --kill-child=KILL -- \
  "${BASH_SOURCE[0]}" --inside "$root" "$targets" &
child=$!
status=0
wait "$child" || status=$?
child=
exit "$status"
