"""opencl_probe.py: runs a tiny kernel on every OpenCL device and prints one line of JSON: a list of {device, platform,
works, problem}. A program of its own, as drivers can crash and hang."""

import ctypes
import json
import sys

SOURCE = b"__kernel void twice(__global int* data) { data[get_global_id(0)] *= 2; }"
COUNT = 64
DEVICE_TYPE_ALL = 0xFFFFFFFF
PLATFORM_NAME = 0x0902
DEVICE_NAME = 0x102B
READ_WRITE_COPY = (1 << 0) | (1 << 5)


class ClError(Exception):
    pass


class Library:
    """Functions of libOpenCL that raise ClError."""

    HANDLES = ("clCreateContext", "clCreateCommandQueue", "clCreateBuffer", "clCreateProgramWithSource",
               "clCreateKernel")

    def __init__(self):
        try:
            self._library = ctypes.CDLL("libOpenCL.so.1")
        except OSError as error:
            raise ClError(f"libOpenCL.so.1 is missing ({error})") from None

    def __getattr__(self, name):
        function = getattr(self._library, name)
        if name in self.HANDLES:
            function.restype = ctypes.c_void_p

            def create(*arguments):
                status = ctypes.c_int()
                handle = function(*arguments, ctypes.byref(status))
                if status.value != 0:
                    raise ClError(f"{name}: {status.value}")
                return ctypes.c_void_p(handle)
            return create

        def call(*arguments):
            status = function(*arguments)
            if status != 0:
                raise ClError(f"{name}: {status}")
        return call


def handles(function, *arguments):
    """The list that a clGet...IDs function gives."""
    count = ctypes.c_uint()
    function(*arguments, 0, None, ctypes.byref(count))
    found = (ctypes.c_void_p * count.value)()
    function(*arguments, count, found, None)
    return [ctypes.c_void_p(handle) for handle in found]


def text(function, handle, what):
    buffer = ctypes.create_string_buffer(256)
    function(handle, what, ctypes.c_size_t(len(buffer)), buffer, None)
    return buffer.value.decode(errors="replace")


def try_device(cl, device):
    """Doubles numbers on it. @throws ClError"""
    context = cl.clCreateContext(None, 1, ctypes.byref(device), None, None)
    queue = cl.clCreateCommandQueue(context, device, ctypes.c_ulong(0))
    data = (ctypes.c_int * COUNT)(*range(COUNT))
    size = ctypes.c_size_t(ctypes.sizeof(data))
    memory = cl.clCreateBuffer(context, ctypes.c_ulong(READ_WRITE_COPY), size, data)
    source = ctypes.c_char_p(SOURCE)
    program = cl.clCreateProgramWithSource(context, 1, ctypes.byref(source), None)
    cl.clBuildProgram(program, 1, ctypes.byref(device), None, None, None)
    kernel = cl.clCreateKernel(program, b"twice")
    cl.clSetKernelArg(kernel, 0, ctypes.c_size_t(ctypes.sizeof(memory)), ctypes.byref(memory))
    items = ctypes.c_size_t(COUNT)
    cl.clEnqueueNDRangeKernel(queue, kernel, 1, None, ctypes.byref(items), None, 0, None, None)
    answer = (ctypes.c_int * COUNT)()
    cl.clEnqueueReadBuffer(queue, memory, 1, ctypes.c_size_t(0), size, answer, 0, None, None)
    if list(answer) != [2 * i for i in range(COUNT)]:
        raise ClError("the kernel's result is wrong")


def probe():
    cl = Library()
    found = []
    for platform in handles(cl.clGetPlatformIDs):
        try:
            devices = handles(cl.clGetDeviceIDs, platform, ctypes.c_ulong(DEVICE_TYPE_ALL))
        except ClError:
            continue  # a platform without devices
        for device in devices:
            entry = {"device": text(cl.clGetDeviceInfo, device, DEVICE_NAME),
                     "platform": text(cl.clGetPlatformInfo, platform, PLATFORM_NAME), "works": True, "problem": ""}
            try:
                try_device(cl, device)
            except ClError as error:
                entry.update(works=False, problem=str(error))
            found.append(entry)
    return found


if __name__ == "__main__":
    try:
        print(json.dumps(probe()))
    except ClError as error:
        print(error)
        sys.exit(1)
