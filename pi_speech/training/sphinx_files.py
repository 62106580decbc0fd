"""Reads and writes the parameter files of CMU Sphinx: Sphinx-III files ("s3") and the sendump of PocketSphinx.

Arrays are float64 here and float32 in the files; files are little endian. One that is damaged or of another kind is a
ToolError naming it.
"""

import struct

import package_path  # noqa: F401: leads to pi_speech
import numpy as np

from pi_speech.errors import ToolError

BYTE_ORDER = 0x11223344
LOG_BASE = 1.0001
SENDUMP_SHIFT = 10           # a step of a weight in a sendump is 2^10 units of log base 1.0001
SENDUMP_LEAST_WEIGHT = 1e-5  # as mk_s2sendump of sphinxtrain has it
SENDUMP_HEADER = ("BEGIN FILE FORMAT DESCRIPTION", "(int32) <length(string)> (including trailing 0)",
                  "<string> (including trailing 0)", "... preceding 2 items repeated any number of times",
                  "(int32) 0 (length(string)=0 terminates the header)", "(int32) <#codewords>", "(int32) <#pdfs>",
                  "256 (int32) cluster-prob values for codebook-0 codeword-0",
                  "#pdf (unsigned char) cluster-prob ids for codebook-0 codeword-0",
                  "... preceding 2 items repeated for all codewords in codebook-0",
                  "preceding 3 items repeated for codebooks 1, 2, 3.", "END FILE FORMAT DESCRIPTION")


class Bytes:
    """A file that is read from front to back."""

    def __init__(self, path):
        self.path = path
        try:
            with open(path, "rb") as file:
                self.content = file.read()
        except OSError as error:
            raise ToolError(f"{path}: {error.strerror or error}") from error
        self.at = 0

    def damaged(self, what):
        return ToolError(f"{self.path}: {what} at byte {self.at}: the file is damaged or of another kind")

    def take(self, count):
        if count < 0 or self.at + count > len(self.content):
            raise self.damaged(f"{count} bytes expected, {len(self.content) - self.at} there")
        self.at += count
        return self.content[self.at - count:self.at]

    def integers(self, count):
        return struct.unpack(f"<{count}i", self.take(4 * count))

    def array(self, shape):
        """The number of values, and that many values. @return float64"""
        count, = self.integers(1)
        if min(shape) < 1 or count != int(np.prod(shape)):
            raise self.damaged(f"{count} values, must be {' x '.join(str(size) for size in shape)},")
        return np.frombuffer(self.take(4 * count), "<f4").reshape(shape).astype(float)


def _open_s3(path):
    file = Bytes(path)
    end = file.content.find(b"endhdr\n", 0, 4096)
    if not file.content.startswith(b"s3\n") or end < 0:
        raise file.damaged('no header from "s3" to "endhdr"')
    file.at = end + len(b"endhdr\n")
    if file.integers(1)[0] != BYTE_ORDER:
        raise file.damaged("no mark of little endian")
    return file


def _write_s3(path, integers, values):
    with open(path, "wb") as file:
        file.write(b"s3\nversion 1.0\nendhdr\n" + struct.pack("<I", BYTE_ORDER))
        file.write(struct.pack(f"<{len(integers) + 1}i", *integers, values.size))
        file.write(values.astype("<f4").tobytes())


def _one_length(file, lengths):
    if len(set(lengths)) != 1:
        raise ToolError(f"{file.path}: streams of lengths {lengths}, must be of one length")
    return lengths[0]


def read_gaussians(path):
    """Means or variances. @return codebook x stream x density x length. @throws ToolError"""
    file = _open_s3(path)
    codebooks, streams, densities = file.integers(3)
    if not 1 <= streams <= 64:
        raise file.damaged(f"{streams} streams")
    length = _one_length(file, file.integers(streams))
    return file.array((codebooks, streams, densities, length))


def write_gaussians(path, values):
    codebooks, streams, densities, length = values.shape
    _write_s3(path, [codebooks, streams, densities] + [length] * streams, values)


def read_mixture_weights(path):
    """Weights or counts of them. @return senone x stream x density. @throws ToolError"""
    file = _open_s3(path)
    return file.array(file.integers(3))


def write_mixture_weights(path, weights):
    _write_s3(path, list(weights.shape), weights)


def read_gaussian_counts(path):
    """What bw has gathered for means and variances.
    @return (sum of x, sum of x^2: codebook x stream x density x length; occupation: codebook x stream x density)
    @throws ToolError"""
    file = _open_s3(path)
    has_means, has_variances, _ = file.integers(3)
    if not has_means or not has_variances:
        raise ToolError(f"{path}: lacks sums for means or variances; write it by bw -meanreest yes -varreest yes")
    codebooks, densities, streams = file.integers(3)
    if not 1 <= streams <= 64:
        raise file.damaged(f"{streams} streams")
    length = _one_length(file, file.integers(streams))
    shape = (codebooks, streams, densities, length)
    sums, squares = file.array(shape), file.array(shape)
    file.integers(3)  # the shape of the last array
    return sums, squares, file.array(shape[:3])


def read_sendump(path):
    """Mixture weights of one byte each. @return senone x stream x density, in (0, 1]. @throws ToolError"""
    file = Bytes(path)
    fields = {}
    while True:
        length, = file.integers(1)
        if length == 0:
            break
        text = file.take(length).rstrip(b"\0").decode("latin-1").split()
        if len(text) == 2:
            fields[text[0]] = text[1]
    if int(fields.get("cluster_count", 0)):
        raise ToolError(f"{path}: weights in clusters (half a byte each), must be of one byte each")
    densities, senones = file.integers(2)
    streams = int(fields.get("feature_count", 1))
    if min(densities, senones, streams) < 1:
        raise file.damaged(f"{streams} streams of {densities} densities, {senones} senones")
    steps = np.frombuffer(file.take(streams * densities * senones), np.uint8).reshape(streams, densities, senones)
    shift = int(fields.get("mixw_shift", SENDUMP_SHIFT))
    return np.power(LOG_BASE, -steps.astype(float) * 2.0 ** shift).transpose(2, 0, 1)


def sendump_steps(weights):
    """@param weights  senone x stream x density
    @return -log of the normalised weights, in steps of a sendump, as bytes; rounded up, as mk_s2sendump does"""
    weights = np.maximum(weights / weights.sum(2, keepdims=True), SENDUMP_LEAST_WEIGHT)
    weights = weights / weights.sum(2, keepdims=True)
    steps = np.ceil(np.floor(-np.log(weights) / np.log(LOG_BASE)) / 2 ** SENDUMP_SHIFT)
    return np.clip(steps, 0, 255).astype(np.uint8)


def write_sendump(path, weights):
    """@param weights  senone x stream x density, not negative, each stream of a senone with a positive sum"""
    senones, streams, densities = weights.shape
    header = [*SENDUMP_HEADER, "cluster_count 0", "codebook_count 1", f"feature_count {streams}"]
    items = [text.encode() + b"\0" for text in header]
    past = sum(4 + len(item) for item in items) % 4
    if past:  # the weights begin at a multiple of four bytes
        items.append(b"!" * (4 - past))
    with open(path, "wb") as file:
        for item in items:
            file.write(struct.pack("<i", len(item)) + item)
        file.write(struct.pack("<3i", 0, densities, senones))
        file.write(sendump_steps(weights).transpose(1, 2, 0).tobytes())
