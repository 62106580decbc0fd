"""Gets files from servers, folders and archives: resumed, checked, and never half under their final name.

Own code: python3-pooch checks sums, but begins a download that broke off anew.
"""

import hashlib
import http.client
import os
import re
import shutil
import tarfile
import time
import urllib.error
import urllib.request
import zlib

from pi_detect.errors import ToolError

TIMEOUT_S = 30.0                       # without a byte
RETRY_DELAYS_S = (1.0, 2.0, 4.0, 8.0)  # between tries that brought nothing
CHUNK = 1 << 18                        # bytes
SIZE_LIMIT = 1 << 30                   # bytes of a file whose size is not published
RETRIED_STATUS = (408, 425, 429, 500, 502, 503, 504)


class Patience:
    """How long downloads may wait for servers that send nothing."""

    def __init__(self, idle_s=None, sleep=time.sleep):
        """@param idle_s  in a row, all tries together [s]; None: RETRY_DELAYS_S and TIMEOUT_S alone count"""
        self._idle_s, self._sleep = idle_s, sleep
        self._last_byte = time.monotonic()

    def bytes_came(self):
        self._last_byte = time.monotonic()

    def timeout_s(self):
        """Of the next wait for a byte, at least a little above 0."""
        return TIMEOUT_S if self._idle_s is None else max(0.01, min(TIMEOUT_S, self._left_s()))

    def wait(self, delay_s):
        """Before another try. @return False: there is no time for one."""
        if self._idle_s is not None and self._left_s() <= delay_s:
            return False
        self._sleep(delay_s)
        return True

    def ended(self):
        return self._idle_s is not None and self._left_s() <= 0.0

    def _left_s(self):
        return self._idle_s - (time.monotonic() - self._last_byte)


class _Retry(Exception):
    """Another try may help."""


class _GiveUp(Exception):
    """This address will not give the file."""


def sums_of(path, algorithms):
    """Dict algorithm -> hexadecimal digits of a file's content. @throws OSError"""
    sums = {algorithm: hashlib.new(algorithm) for algorithm in algorithms}
    with open(path, "rb") as file:
        while chunk := file.read(CHUNK):
            for one in sums.values():
                one.update(chunk)
    return {algorithm: one.hexdigest() for algorithm, one in sums.items()}


def mismatch(path, sums):
    """What is wrong with a file's content, or "" if it has all the sums. @throws OSError"""
    actual = sums_of(path, sums)
    return "; ".join(f"{algorithm} is {actual[algorithm]}, must be {expected}"
                     for algorithm, expected in sums.items() if actual[algorithm] != expected)


def part_of(path):
    """Where a file grows until it is whole and checked."""
    return path.with_name(path.name + ".part")


def _open(url, have, timeout_s):
    headers = {"User-Agent": "pi_detect fetch_models"}
    if have:
        headers["Range"] = f"bytes={have}-"
    try:
        return urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=timeout_s)
    except urllib.error.HTTPError as error:
        with error:
            if error.code == 416 and have:
                raise
            text = f"HTTP {error.code} {error.reason}"
            raise (_Retry if error.code in RETRIED_STATUS else _GiveUp)(text) from error
    except (OSError, http.client.HTTPException) as error:
        raise _Retry(str(getattr(error, "reason", error)) or type(error).__name__) from error


def _transfer(url, part, size, progress, patience):
    """Adds what is missing to the part. Raises _Retry if it is not whole then, _GiveUp if it cannot be."""
    have = part.stat().st_size if part.exists() else 0
    if size and have == size:
        return
    if have > (size or SIZE_LIMIT):
        part.unlink()
        have = 0
    try:
        response = _open(url, have, patience.timeout_s())
    except urllib.error.HTTPError as error:
        # Nothing behind what is there: the file is whole, or another one.
        if error.headers.get("Content-Range", "") == f"bytes */{have}":
            return
        part.unlink()
        raise _Retry("the server does not go on where the part ends") from error
    with response:
        begins = re.match(r"bytes (\d+)-", response.headers.get("Content-Range", ""))
        is_rest = response.status == 206 and begins is not None and int(begins[1]) == have
        if response.status == 206 and not is_rest:
            part.unlink(missing_ok=True)
            raise _Retry("the server sent another part than was asked for")
        if not is_rest:
            have = 0
        length = response.headers.get("Content-Length", "")
        total = have + int(length) if length.isdigit() else 0
        if size and total and total != size:
            raise _GiveUp(f"has {total} bytes, must have {size}")
        limit = size or SIZE_LIMIT
        with open(part, "ab" if is_rest else "wb") as file:
            while True:
                try:
                    chunk = response.read1(CHUNK)
                except (OSError, http.client.HTTPException) as error:
                    raise _Retry(f"cut after {have} bytes: {error}") from error
                if not chunk:
                    break
                if have + len(chunk) > limit:
                    raise _GiveUp(f"has more than {limit} bytes")
                file.write(chunk)
                have += len(chunk)
                patience.bytes_came()
                progress(have, total or size)
    if have < (total or size):
        raise _Retry(f"cut after {have} of {total or size} bytes")


def _size(path):
    return path.stat().st_size if path.exists() else 0


def _get(url, part, size, progress, patience):
    """Transfers, again and again as long as that helps. Raises _GiveUp."""
    delays = iter(RETRY_DELAYS_S)
    while True:
        before = _size(part)
        try:
            return _transfer(url, part, size, progress, patience)
        except _Retry as error:
            if _size(part) > before:
                delays = iter(RETRY_DELAYS_S)
            delay = next(delays, None)
            if delay is None:
                raise _GiveUp(f"{error}, tried {len(RETRY_DELAYS_S) + 1} times") from error
            if not patience.wait(delay):
                raise _GiveUp(str(error)) from error


def download(urls, path, sums, size, progress, patience):
    """Brings a file to path: from the first address that gives one with all the sums.

    What came so far lies beside it with the ending .part, also after an interruption; the next call goes on there.
    @param size      bytes, 0: unknown
    @param progress  called with (bytes so far, bytes in all or 0) after every chunk
    @param patience  with servers that send nothing
    @throws ToolError naming every address and why it did not help; a part with a wrong sum is removed
    @throws OSError   if the file cannot be written
    """
    part = part_of(path)
    reasons = []
    for url in urls:
        if patience.ended():
            reasons.append(f"{url}: not tried")
            continue
        # A wrong sum may come from what an earlier run left: once more from the beginning.
        for is_resumed in (True, False) if part.exists() else (False,):
            try:
                _get(url, part, size, progress, patience)
            except _GiveUp as error:
                reasons.append(f"{url}: {error}")
                break
            wrong = mismatch(part, sums)
            if not wrong:
                os.replace(part, path)
                return
            part.unlink()
            if not is_resumed:
                reasons.append(f"{url}: {wrong}; removed, it is not the published file")
    raise ToolError(f"{path.name} was not fetched. " + ". ".join(reasons))


def copy(source, path, sums):
    """Copies a local file if it has all the sums. @throws ToolError @throws OSError"""
    part = part_of(path)
    shutil.copyfile(source, part)
    wrong = mismatch(part, sums)
    if wrong:
        part.unlink()
        raise ToolError(f"{source}: {wrong}: it is not the published file, get another copy")
    os.replace(part, path)


def extract(archive, member, path, sums):
    """Brings one regular file of a tar archive to path; no name inside the archive says where anything is written.
    @throws ToolError @throws OSError"""
    part = part_of(path)
    try:
        with tarfile.open(archive) as tar:
            info = tar.getmember(member)
            if not info.isreg():
                raise ToolError(f"{archive.name}: {member} is no regular file")
            if info.size > SIZE_LIMIT:
                raise ToolError(f"{archive.name}: {member} has {info.size} bytes, may have {SIZE_LIMIT}")
            with tar.extractfile(info) as source, open(part, "wb") as file:
                shutil.copyfileobj(source, file, CHUNK)
    except KeyError as error:
        raise ToolError(f"{archive.name} does not contain {member}") from error
    except (tarfile.TarError, EOFError, zlib.error) as error:
        part.unlink(missing_ok=True)
        raise ToolError(f"{archive.name} cannot be unpacked: {error}") from error
    wrong = mismatch(part, sums)
    if wrong:
        part.unlink()
        raise ToolError(f"{archive.name}: {member}: {wrong}")
    os.replace(part, path)
