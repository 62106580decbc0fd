#!/usr/bin/env bash
# Builds packages of the suite for arm64 and runs their tests, on an amd64 computer: makes an arm64 Debian 12 with
# debootstrap, whose programs qemu-user executes, and compiles there with the cross-compiler of this computer, ten times
# faster than an emulated one. What it proves: that the code is right for arm64. qemu keeps the memory order of x86, so
# it proves nothing of ordering (the model checker does that, docs/design/memory_ordering.md), and no time measured here
# means anything.
#
# Nothing of this computer changes: qemu is registered in a user namespace of its own (Linux 6.7), which ends with this
# script. A FOLDER that has a system already is used again: only what changed is built.
set -euo pipefail

PACKAGES='pi_node pi_os_transport'
TESTS=_gtest_    # the tests on the graph start dozens of emulated nodes, and measure time
# What qemu-user does not do: limit the address space (RLIMIT_AS), give all of TCP_INFO (4 of 104 bytes), share memory
# with the child of posix_spawn(), by which a program that cannot be started is known, and keep a mapping from a forked
# child (MADV_DONTFORK).
LEFT_OUT_CASES=SlotPool.WithoutAddressSpaceEveryAllocationFails:SpTransport.MeasuresTheNetworkWithoutAProcessThatReadsNothing
LEFT_OUT_CASES+=:ChildProcess.NamesAProgramThatCannotBeStarted:ImageCodecTest.MissingWorkerIsNamed
LEFT_OUT_CASES+=:ModelCheck.AProgramThatIsMissingIsNamed:UnitTableTest.AForkedChildHasNoPartInTheUnit
LEFT_OUT_CASES+=:SpeechModelCheck.AMissingProgramIsNamedWithAWayOut:SpeechModelCheck.TooLittleMemoryIsAnError
# What is only for the demo, the benchmarks and the page.
LEFT_OUT='chromium imagemagick libgl1-mesa-dri opencv-doc rviz spin stress-ng wireguard-go wireguard-tools x11-utils xvfb'
CROSS=/usr/bin/aarch64-linux-gnu-g++-12
QEMU=/usr/bin/qemu-aarch64-static

usage() {
  cat <<END
usage: test/arm64.sh [--packages "$PACKAGES"] [--tests REGEX] [--working-tree] FOLDER
  --packages      to build and test, with all that they need
  --tests         those whose names match (default: $TESTS, the unit tests)
  --working-tree  copy the files as they are now, not the last commit
  FOLDER          of the arm64 system: absent, empty, or left by this script; 5 GB
MIRROR, if set, is where Debian comes from; otherwise debootstrap's own default. JOBS limits the compilers.
END
}

fail() {
  echo "arm64: $*" >&2
  exit 1
}

in_chroot() {
  local root=$1
  shift
  env -i HOME=/root USER=root TERM="${TERM:-dumb}" LC_ALL=C.UTF-8 ROS_HOSTNAME=localhost DEBIAN_FRONTEND=noninteractive \
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin chroot "$root" "$@" </dev/null
}

# once ROOT NAME COMMAND...: unless an earlier run of this script has done it.
once() {
  local mark=$1/root/.arm64_$2
  [ -e "$mark" ] && return
  echo "=== $2"
  shift 2
  "$@"
  touch "$mark"
}

mount_kernel() {
  mount -t proc proc "$1/proc"
  mount -t tmpfs -o mode=1777 tmpfs "$1/dev/shm"
  mount -t devpts -o newinstance,ptmxmode=0666 devpts "$1/dev/pts"
}

# Makes programs of arm64 run, and those of this computer as well, which are at /x.
enter() {
  local root=$1 magic mask
  mount --bind "$root" "$root"
  mkdir -p "$root/proc" "$root/sys" "$root/dev/pts" "$root/dev/shm" "$root/x/usr"
  mount_kernel "$root"
  mount --rbind /sys "$root/sys"
  mount --bind /usr "$root/x/usr"
  mount -t binfmt_misc binfmt_misc "$root/proc/sys/fs/binfmt_misc" ||
    fail "no binfmt_misc in a user namespace: needs Linux 6.7, this is $(uname -r)"
  magic='\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00'
  mask='\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff'
  echo ":qemu-aarch64:M::$magic:$mask:$QEMU:F" >"$root/proc/sys/fs/binfmt_misc/register"
}

# debootstrap wants to make device nodes, which a user namespace forbids: those of first_stage serve.
second_stage() {
  sed -i 's/^check_sane_mount () {/&\n\treturn 0/' "$1/debootstrap/functions"
  in_chroot "$1" /debootstrap/debootstrap --second-stage >"$1/root/second_stage.log" 2>&1 || {
    tail -n 20 "$1/root/second_stage.log" >&2
    fail "debootstrap's second stage failed; the whole log is $1/root/second_stage.log"
  }
  mount_kernel "$1"    # debootstrap has unmounted them
}

# With what it depends on: apt of the new system decides, and gets it.
download_dependencies() {
  local root=$1 wanted
  wanted=$(sed 's/#.*//' "$root/root/pi_edge/dependencies.txt" | grep -vxF "${LEFT_OUT// /$'\n'}")
  echo '127.0.0.1 localhost' >"$root/etc/hosts"
  in_chroot "$root" apt-get -q update
  # shellcheck disable=SC2086  # one word per package
  in_chroot "$root" apt-get -q -o APT::Keep-Downloaded-Packages=true install -y --no-install-recommends --download-only \
    $wanted
}

# By the dpkg-deb of this computer: an emulated dpkg needs an hour of processor time. No package is configured, which a
# compiler and tests do not need, except that the libraries of linear algebra are found by alternatives.
unpack_dependencies() {
  local root=$1 libraries=$1/usr/lib/aarch64-linux-gnu archive library
  for archive in "$root"/var/cache/apt/archives/*.deb; do
    dpkg-deb --fsys-tarfile "$archive" | tar -x --keep-directory-symlink -C "$root"
  done
  for library in "$libraries"/*/lib{blas,lapack}.so{,.3}; do
    [ ! -e "$library" ] || ln -sfn "${library#"$libraries/"}" "$libraries/${library##*/}"
  done
}

# The cross-compiler finds its parts beside itself at /x, and headers and libraries for arm64 where they always are.
link_cross_compiler() {
  local root=$1 name
  ln -sfn x/usr/lib64 "$root/lib64"
  ln -sfn /x/usr/lib/x86_64-linux-gnu "$root/usr/lib/x86_64-linux-gnu"
  ln -sfn /x/usr/aarch64-linux-gnu "$root/usr/aarch64-linux-gnu"
  for name in gcc g++; do
    printf '#!/bin/sh\nexec %s /x/usr/bin/aarch64-linux-gnu-%s-12 "$@"\n' \
      "$([ -x /usr/bin/ccache ] && echo /x/usr/bin/ccache)" "$name" >"$root/usr/local/bin/cross-$name"
    chmod 755 "$root/usr/local/bin/cross-$name"
  done
}

inside() {
  local root=$1 packages=$2 tests=$3 jobs=$4 targets build=/root/pi_edge/build
  enter "$root"
  once "$root" second_stage second_stage "$root"
  once "$root" download_dependencies download_dependencies "$root"
  once "$root" unpack_dependencies unpack_dependencies "$root"
  link_cross_compiler "$root"
  in_chroot "$root" ldconfig
  echo "=== configure: $(in_chroot "$root" uname -m)"
  in_chroot "$root" cmake -G Ninja -S /root/pi_edge -B "$build" -DCMAKE_BUILD_TYPE=Release \
    -DPYTHON_EXECUTABLE=/usr/bin/python3 -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=5 \
    -DCMAKE_C_COMPILER=/usr/local/bin/cross-gcc -DCMAKE_CXX_COMPILER=/usr/local/bin/cross-g++
  for package in $packages; do targets="${targets-} check_$package"; done
  echo "=== build$targets"
  # shellcheck disable=SC2086
  in_chroot "$root" ninja -C "$build" -j "$jobs" $targets
  echo "=== test; left out: $LEFT_OUT_CASES"
  # shellcheck disable=SC2016
  in_chroot "$root" env GTEST_FILTER="-$LEFT_OUT_CASES" sh -c \
    '. "$0/devel/setup.sh" && exec ctest --test-dir "$0" --output-on-failure "$@"' "$build" \
    -R "^_ctest_(${packages// /|})(_.*)?($tests)"
}

if [ "${1-}" = --inside ]; then
  inside "${@:2}"
  exit
fi

packages=$PACKAGES tests=$TESTS which=HEAD root=''
while [ $# -gt 0 ]; do
  case $1 in
    --packages) packages=${2?--packages needs a value}; shift ;;
    --tests) tests=${2?--tests needs a value}; shift ;;
    --working-tree) which=working-tree ;;
    -h | --help) usage; exit 0 ;;
    -*) usage >&2; fail "unknown option $1" ;;
    *) [ -z "$root" ] || fail "one FOLDER at most, got $root and $1"; root=$1 ;;
  esac
  shift
done
[ -n "$root" ] || { usage >&2; fail 'FOLDER is missing: where the arm64 system is made'; }
[ "$(id -u)" = 0 ] || fail 'needs root, to make a system and a namespace: run it with sudo'
[ "$(uname -m)" = x86_64 ] || fail "is for an amd64 computer; on $(uname -m), make check does all of this"
for file in /usr/sbin/debootstrap "$QEMU" "$CROSS"; do
  [ -x "$file" ] || fail "$file is missing: apt-get install debootstrap qemu-user-static g++-12-aarch64-linux-gnu"
done
top=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
for package in $packages; do
  [ -e "$top/$package/package.xml" ] || fail "--packages $package: no package of the suite"
done
mkdir -p -- "$root"
root=$(cd -- "$root" && pwd -P)
[ -e "$root/root/.arm64_first_stage" ] || [ -z "$(ls -A -- "$root")" ] ||
  fail "$root is neither empty nor a system that this script made: name another folder"

first_stage() {
  debootstrap --arch=arm64 --foreign --variant=minbase bookworm "$root" ${MIRROR:+"$MIRROR"} >"$root.log" 2>&1 || {
    tail -n 20 "$root.log" >&2
    fail "debootstrap failed; the whole log is $root.log"
  }
  local node
  for node in null:3 zero:5 full:7 random:8 urandom:9; do
    [ -e "$root/dev/${node%:*}" ] || mknod -m 666 "$root/dev/${node%:*}" c 1 "${node#*:}"
  done
  [ -e "$root/dev/tty" ] || mknod -m 666 "$root/dev/tty" c 5 0
  [ -e "$root/dev/console" ] || mknod -m 600 "$root/dev/console" c 5 1
  ln -sfn pts/ptmx "$root/dev/ptmx"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  rm -f "$root.log"
}
# files FOLDER: of the suite, with a zero byte after each.
files() {
  (cd "$1" && find . \( -path ./build -o -path ./install \) -prune -o \( -type f -o -type l \) -print0 | sort -z)
}

# take_over FROM TO: with the time of now, and only what differs. A copy that kept its time may be older than what was
# compiled from the copy before, and would not be compiled again.
take_over() {
  local from=$1 to=$2 file
  comm -z -13 <(files "$from") <(files "$to") | (cd "$to" && xargs -0 -r rm -f --)
  files "$from" | while IFS= read -r -d '' file; do
    cmp -s "$from/$file" "$to/$file" && continue
    mkdir -p "$to/${file%/*}"
    cp --no-dereference --remove-destination "$from/$file" "$to/$file"
  done
}

once "$root" first_stage first_stage
mkdir -p "$root/root/pi_edge"
work=$(mktemp -d)
child=
finish() {
  [ -z "$child" ] || kill -KILL "$child" 2>/dev/null || true    # all in its process namespace end with it
  rm -rf "$work"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP
mkdir "$work/suite"
if [ "$which" = working-tree ]; then
  "$top/scripts/copy_suite" "$work/suite"
else
  git -C "$top" archive HEAD | tar -x --no-same-owner -C "$work/suite"
fi
take_over "$work/suite" "$root/root/pi_edge"

# Users 0 to 65535 as outside, which only this process may write, after the other has made the namespace: that one opens
# the pipe then.
mkfifo "$work/mapped"
# shellcheck disable=SC2016
unshare --user -- sh -c 'read -r _ <"$1" && shift && exec "$@"' sh "$work/mapped" \
  unshare --mount --propagation private --pid --fork --kill-child=KILL -- \
  "${BASH_SOURCE[0]}" --inside "$root" "$packages" "$tests" "${JOBS:-$(nproc)}" &
child=$!
exec 3>"$work/mapped"
echo '0 0 65536' >"/proc/$child/uid_map"
echo '0 0 65536' >"/proc/$child/gid_map"
echo >&3
status=0
wait "$child" || status=$?
child=
exit "$status"
