#!/usr/bin/python3 -B
"""Judge of crash_model.test: searches link.pml with spin, and holds its steps against those of the code."""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import sweep_victim  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

FOLDER = pathlib.Path(__file__).resolve().parent
MODEL = FOLDER / 'link.pml'
SOURCES = FOLDER.parents[1] / 'src' / 'shm'
STEP = re.compile(r'STEP\("(\w+)\.(\w+)"\)')
MUTANTS = 5
# Sizes of the model; the search tries all orders of steps, also those that partial order reduction takes for equal.
PROGRAMS = [dict(LINKS=1, MESSAGES=4, CRASHES=3, LIVES=2), dict(LINKS=2, MESSAGES=1, CRASHES=2, LIVES=1)]
LARGE_PROGRAM = dict(LINKS=2, MESSAGES=2, CRASHES=1, LIVES=1)  # 44 million states, with partial order reduction


def steps(text):
    """operation -> its steps, in the order of the text."""
    found = {}
    for operation, step in STEP.findall(text):
        if step not in found.setdefault(operation, []):
            found[operation].append(step)
    return found


def model(**sizes):
    """The model with these sizes, as spin would see it, but with the names of its steps."""
    text = MODEL.read_text().replace('#define STEP(name)', '#define CRASH')
    command = ['cpp', '-P', '-undef', '-I', str(FOLDER)] + ['-D%s=%d' % size for size in sizes.items()]
    return subprocess.run(command, input=text, stdout=subprocess.PIPE, check=True, text=True).stdout


@unittest.skipUnless(shutil.which('spin'), 'spin is not installed: apt-get install spin')
class CrashModel(harness.TransportTest):

    def search(self, text, flags=('-DNOREDUCE',), optimise='-O2'):
        """What spin's search says: the number of errors, and the whole text."""
        folder = self.scratch()
        shutil.copytree(FOLDER, folder, dirs_exist_ok=True)
        pathlib.Path(folder, 'link.pml').write_text(text)
        for command in (['spin', '-a', 'link.pml'],
                        ['gcc', optimise, '-DSAFETY', '-DCOLLAPSE', *flags, '-o', 'search', 'pan.c'],
                        ['./search', '-m1000000']):
            done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            self.assertEqual(done.returncode, 0, done.stdout)
        return int(re.search(r'errors: (\d+)', done.stdout).group(1)), done.stdout

    def sized(self, **sizes):
        return ''.join('#define %s %d\n' % size for size in sizes.items()) + MODEL.read_text()

    def test_no_crash_costs_a_survivor_anything(self):
        for sizes in PROGRAMS:
            self.search_all(sizes)
        if os.environ.get('PI_EDGE_SOAK') == '1':
            self.search_all(LARGE_PROGRAM, [])

    def search_all(self, sizes, *flags):
        with self.subTest(sizes):
            errors, output = self.search(self.sized(**sizes), *flags)
            states = int(float(re.search(r'(\S+) states, stored', output).group(1)))
            print('%9d states: %s' % (states, sizes))
            self.assertEqual(errors, 0, output)
            self.assertNotRegex(output, 'not completed|too small')
            self.assertGreater(states, 100000, output)

    def test_the_search_finds_mistakes(self):
        for mutant in range(1, MUTANTS + 1):
            with self.subTest(mutant):
                self.assertEqual(self.search(self.sized(MUTANT=mutant), optimise='-O0')[0], 1)

    def test_the_search_comes_across_every_step(self):
        text = self.sized().replace('#define STEP(name)', '#define STEP(name) c_code { printf("AT %s\\n", name); };')
        output = self.search('c_decl {\n\\#include <stdio.h>\n};\n' + text, optimise='-O0')[1]
        self.assertEqual(set(re.findall(r'^AT (\S+)$', output, re.M)),
                         {'%s.%s' % (operation, step) for operation, names in steps(model()).items() for step in names})

    def test_the_steps_are_those_of_the_code(self):
        code = steps('\n'.join(file.read_text() for file in sorted(SOURCES.iterdir())))
        self.assertEqual(steps(model()), code)
        if self.preload:
            marked = sweep_victim.marked_steps(self.preload)
            self.assertEqual(marked, {'%s.%s' % (operation, step) for operation in code for step in code[operation]})


if __name__ == '__main__':
    harness.main(CrashModel, plain=False)
