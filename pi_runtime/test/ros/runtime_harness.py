"""What the rostests of the runtime node have in common: its services, and images with their expected results."""

import struct
import subprocess
import time

import numpy
import roslib.packages
import rospkg
import rospy
from pi_runtime import srv
from pi_runtime.msg import Task, TaskArgument

TIMEOUT_S = 30
BURT_ADELSON = numpy.array([1, 4, 6, 4, 1], dtype=numpy.int64)  # of pyramid.h


class Services:
    """Services of a runtime node as methods: submit_task(task=..., wait=True)."""

    def __init__(self, node):
        self.node = node

    def __getattr__(self, name):
        kind = getattr(srv, "".join(word.capitalize() for word in name.split("_")))
        service = self.node + "/" + name
        rospy.wait_for_service(service, TIMEOUT_S)
        proxy = rospy.ServiceProxy(service, kind)
        setattr(self, name, proxy)
        return proxy


def until(condition, what):
    """Asks again and again, as a client of query_task does. @return what condition returned in the end."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        result = condition()
        if result:
            return result
        time.sleep(0.01)
    raise AssertionError("%s: not within %d s" % (what, TIMEOUT_S))


def find_program(package, program):
    paths = roslib.packages.find_node(package, program, rospkg.RosPack())
    if not paths:
        raise RuntimeError("%s of %s is not installed or not built" % (program, package))
    return paths[0]


def start(package, program, *arguments):
    return subprocess.Popen([find_program(package, program), *arguments], stdout=subprocess.PIPE,
                            stderr=subprocess.STDOUT, text=True)


# ------------------------------------------------------------------------------------------------------------ arguments

def in_(data, buffer=""):
    return TaskArgument(kind=TaskArgument.IN, data=bytes(data), buffer=buffer)


def out(size, buffer=""):
    return TaskArgument(kind=TaskArgument.OUT, bytes=size, buffer=buffer)


def value(layout, *numbers):
    return TaskArgument(kind=TaskArgument.VALUE, data=struct.pack("<" + layout, *numbers))


# --------------------------------------------------------------------------------------------------------------- images

def picture(height, width, seed=1):
    return numpy.random.RandomState(seed).randint(0, 256, (height, width), dtype=numpy.uint8)


def halve_task(source, destination, height, width, **fields):
    return Task(codelet="pyramid_down", range=(height + 1) // 2,
                arguments=[source, destination, value("5i", width, height, width, (width + 1) // 2, 0)], **fields)


def halved_size(height, width):
    return (height + 1) // 2 * ((width + 1) // 2)


def halve_picture_task(image, **fields):
    return halve_task(in_(image.tobytes()), out(halved_size(*image.shape)), *image.shape, **fields)


def filtered(image, weights):
    """Sums weighted in both directions; pixels outside are mirrored at the outermost one."""
    radius = len(weights) // 2
    padded = numpy.pad(image.astype(numpy.int64), radius, mode="reflect")
    height, width = image.shape
    columns = sum(weight * padded[i:i + height] for i, weight in enumerate(weights))
    return sum(weight * columns[:, i:i + width] for i, weight in enumerate(weights))


def halved(image):
    return ((filtered(image, BURT_ADELSON) + (1 << 7)) >> 8)[::2, ::2].astype(numpy.uint8)
