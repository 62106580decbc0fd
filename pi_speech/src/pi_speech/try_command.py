"""Asks to say a command several times and tells how often the recogniser heard it, and what it heard instead.

  try_command stop                      # five times, with the recogniser that runs
  try_command "go left" --times 10 --recognizer /speech/recognizer

The recogniser must run and know the command. Exit status: 0 if each time was heard, 1 if not or if nothing can be
tried, 2 for a wrong command line.
"""

import argparse
import queue
import sys
from collections import Counter
from dataclasses import dataclass

from pi_speech.errors import ToolError

ACCEPTED, DOUBTFUL, REJECTED = "heard", "perhaps heard", "rejected"
RANK = (ACCEPTED, DOUBTFUL, REJECTED)
MORE_S = 0.5  # after an answer: a word may be rejected in its utterance and be accepted from the stream


@dataclass
class Answer:
    """What the recogniser made of a word."""

    text: str
    verdict: str
    confidence: float

    def __str__(self):
        return f"{self.verdict} \"{self.text}\", confidence {self.confidence:.2f}" if self.text else self.verdict


def best_of(answers, command):
    """The answer that counts for one time: accepted ones before doubtful and rejected ones, the command before others,
    then the surest. None: nothing was heard."""
    return min(answers, key=lambda one: (RANK.index(one.verdict), one.text != command, -one.confidence), default=None)


def is_right(answer, command):
    return answer is not None and answer.verdict == ACCEPTED and answer.text == command


def summary(command, answers):
    """@param answers  one per time, None for silence. @return lines."""
    right = sum(is_right(one, command) for one in answers)
    lines = [f"\"{command}\" was heard {right} of {len(answers)} times"]
    doubtful = sum(one is not None and one.verdict == DOUBTFUL and one.text == command for one in answers)
    if doubtful:
        lines.append(f"  perhaps heard: {doubtful} times")
    faint = [one.confidence for one in answers
             if one is not None and one.verdict == REJECTED and one.text == command]
    if faint:
        lines.append(f"  too faint: {len(faint)} times, confidence {min(faint):.2f} to {max(faint):.2f}")
    silent = sum(one is None for one in answers)
    if silent:
        lines.append(f"  nothing at all: {silent} times; is the microphone on, and its level in /diagnostics well?")
    others = Counter(one.text or "(no command)" for one in answers if one is not None and one.text != command)
    if others:
        text, count = others.most_common(1)[0]
        lines.append(f"  nearest confusion: \"{text}\", {count} times" if text[0] != "(" else
                     f"  taken for other speech or noise: {count} times")
    return lines


class Listener:
    """Collects what a recogniser publishes."""

    def __init__(self, recognizer):
        import rospy
        from pi_speech.msg import VoiceCommand
        self._rospy = rospy
        self._heard = queue.Queue()
        space = recognizer.rsplit("/", 1)[0]
        self._subscribers = [
            rospy.Subscriber(topic, VoiceCommand,
                             lambda message, verdict=verdict: self._heard.put(
                                 Answer(message.text, verdict, message.confidence)))
            for topic, verdict in ((f"{space}/command", ACCEPTED), (f"{space}/doubtful_command", DOUBTFUL),
                                   (f"{recognizer}/rejected", REJECTED))]

    def wait_for_recognizer(self, timeout_s):
        end = self._rospy.get_time() + timeout_s
        while not all(one.get_num_connections() for one in self._subscribers):
            if self._rospy.is_shutdown() or self._rospy.get_time() > end:
                missing = [one.resolved_name for one in self._subscribers if not one.get_num_connections()]
                raise ToolError(f"nobody publishes {', '.join(missing)}; start recognizer.launch, or name the "
                                "recogniser by --recognizer")
            self._rospy.sleep(0.05)

    def next(self, timeout_s):
        """@return all answers to one word."""
        while not self._heard.empty():
            self._heard.get()
        answers = []
        try:
            answers.append(self._heard.get(timeout=timeout_s))
            while True:
                answers.append(self._heard.get(timeout=MORE_S))
        except queue.Empty:
            return answers


def parse(arguments):
    parser = argparse.ArgumentParser(prog="try_command", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", help="as in the table of commands")
    parser.add_argument("--times", type=int, default=5, help="default: %(default)s")
    parser.add_argument("--recognizer", default="/recognizer", help="name of its node; default: %(default)s")
    parser.add_argument("--patience", type=float, default=6.0, help="[s] to wait for each word; default: %(default)s")
    line = parser.parse_args(arguments)
    line.command = " ".join(line.command.lower().split())
    if line.times < 1 or line.patience <= 0.0 or not line.command:
        parser.error("--times and --patience must be above 0, and the command must have words")
    if not line.recognizer.startswith("/"):
        parser.error(f"--recognizer {line.recognizer}, must be a full name such as /recognizer")
    return line


def main(arguments=None):
    import rosgraph
    import rospy
    line = parse(rospy.myargv()[1:] if arguments is None else arguments)
    try:
        if not rosgraph.is_master_online():
            raise ToolError(f"no ROS master at {rosgraph.get_master_uri()}; start recognizer.launch, or set "
                            "ROS_MASTER_URI")
        rospy.init_node("try_command", anonymous=True, disable_signals=True)
        listener = Listener(line.recognizer)
        listener.wait_for_recognizer(line.patience)
        answers = []
        for number in range(line.times):
            print(f"{number + 1} of {line.times}: say \"{line.command}\"", flush=True)
            answers.append(best_of(listener.next(line.patience), line.command))
            print(f"  {answers[-1] or 'nothing came'}", flush=True)
    except ToolError as error:
        print(f"try_command: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1
    print("\n".join(summary(line.command, answers)))
    return 0 if all(is_right(one, line.command) for one in answers) else 1
