"""Writes prompt templates that ask exactly as a checkout of the benchmark's public toolkit does.

    python3 from_toolkit.py CHECKOUT FOLDER

runs the code of the checkout that makes prompts, with marks in place of the parts that differ between prompts, and
writes into FOLDER a template for each task (`Transport.j2`, ...), one for all tasks (`all.j2`) and the system message
(`system.txt`). Use them with

    swarmbench eval --prompt-template FOLDER/all.j2 --system @FOLDER/system.txt \\
        --answer-reader first-marker --rules reference ...

Prompts are the same to the byte except for the order of messages: here messages are sorted by their text, so that the
order does not reveal the senders. The program runs the code of the checkout, so use one that you trust. Only Python
itself is needed.
"""

import argparse
import ast
import importlib
import sys
import types
from pathlib import Path
from unittest import mock

TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"]
MEMORY = 5
NAME, ROUND, SCORE, SHAPE = "Agent_<name>", "<round>", "<score>", "<shape>"


class Problem(Exception):
    """The checkout differs from the versions that this program knows."""


def modules(checkout):
    """The modules of the checkout that make prompts. Their other imports are not needed for prompts."""
    for name in ["numpy", "scipy", "scipy.optimize", "pulp", "openai", "colorama"]:
        sys.modules[name] = mock.MagicMock()
    for name in ["framework", "swarmbench"]:
        package = types.ModuleType(name)
        package.__path__ = [str(checkout / name)]
        sys.modules[name] = package
    try:
        return importlib.import_module("swarmbench.agent"), importlib.import_module("swarmbench.task")
    except (ImportError, SyntaxError) as error:
        raise Problem(f"{checkout} is no checkout of the toolkit: {error}") from error


class View:
    """The cells that an agent sees, with the methods of an array that are used."""

    shape = (3, 3)

    def __init__(self):
        self.cells = {(i, j): "." for i in range(3) for j in range(3)} | {(0, 1): "10", (0, 2): "$3"}

    def __getitem__(self, at):
        return self.cells[at]

    def __setitem__(self, at, cell):
        self.cells[at] = cell


def check_table(agent):
    expected = "     8   9  10\n  2  .   10  $3  \n  3  .   Y   .   \n  4  .   .   .   \n"
    if agent.view2str(View(), (3, 9)) != expected:
        raise Problem("it draws what agents see in another form than `views[n].padded`")


class Asking:
    """Makes prompts of one task."""

    def __init__(self, agent, task, name):
        self.agent, self.name = agent, name
        self.task = getattr(task, name)(1)
        self.task.score, self.task.shape_desc = SCORE, SHAPE
        agent.view2str = lambda _view, _offset: "<view>"

    def prompt(self, views=1, messages=0, history=0, state=True):
        player = self.agent.SwarmAgent(NAME, mock.MagicMock(), "", memory=MEMORY)
        player.views = ["<view>"] * (views - 1)
        entry = self.entry()
        marks = {"round": "<past>", "action": "<action>", "message": "<said>"}
        player.history = [entry | marks] * history
        self.task.agent_state = self.task.food_state = {NAME: state}
        seen = {"task": self.task, "level": self.task, "round": ROUND, "view": None, "name": NAME,
                "position": {"x": 1, "y": 1}}
        return player.gen_prompt(seen, {f"<sender {n}>": "<message>" for n in range(messages)})

    def entry(self):
        """The entry of the history for an answer without a decision."""
        player = self.agent.SwarmAgent(NAME, mock.MagicMock(), "", memory=MEMORY)
        with mock.patch("builtins.print"):
            player.to_action("nothing")
        return player.history[0]


def plain(text):
    """A text as a template prints it."""
    pieces = []
    for part in text.split("{"):
        pieces.append(part)
    text = "{{ '{' }}".join(pieces) if any(sign in text for sign in ("{{", "{%", "{#")) else text
    for mark, variable in [(NAME, "{{ agent }}"), (ROUND, "{{ round }}"), (SCORE, "{{ score|int }}")]:
        text = text.replace(mark, variable)
    row = tag("for cell in row") + "{{ cell }}" + tag("if not loop.last") + " " + tag("endif") + tag("endfor")
    rows = tag("for row in target") + row + tag("if not loop.last") + "\n" + tag("endif") + tag("endfor")
    return text.replace(SHAPE, rows)


def tag(what):
    """A tag that keeps all white space around it."""
    return "{%+ " + what + " +%}"


def choice(cases, otherwise):
    """The first text whose condition is true."""
    if not cases:
        return otherwise
    parts = [tag(f"{'elif' if n else 'if'} {condition}") + text for n, (condition, text) in enumerate(cases)]
    return "".join(parts) + tag("else") + otherwise + tag("endif")


def ends(one, other):
    """The numbers of characters that two texts share at the beginning, and then at the end."""
    most = min(len(one), len(other))
    first = next((n for n in range(most) if one[n] != other[n]), most)
    last = next((n for n in range(most - first) if one[-1 - n] != other[-1 - n]), most - first)
    return first, last


def listed(asked, name, marks, variable, printed):
    """The text before a list, the list as a template, and the text after it."""
    none, one, two = (asked.prompt(**{name: count}) for count in (0, 1, 2))
    first, last = ends(none, one)
    head, tail = one[:first], one[len(one) - last:]
    item = one[first:len(one) - last]
    again = two[first:len(two) - last]
    start, end = item.find(marks[0]), item.rfind(marks[-1]) + len(marks[-1])
    if start < 0 or not again.startswith(item[:end]) or not again.endswith(item[start:]):
        raise Problem(f"its list of {name} is not understood")
    between = again[end:len(again) - len(item[start:])]
    body = item[start:end]
    for mark, value in zip(marks, printed, strict=True):
        body = body.replace(mark, value)
    empty = none[first:len(none) - last]
    text = (tag(f"for one in {variable}") + choice([("loop.first", plain(item[:start]))], plain(between)) + body
            + tag("if loop.last") + plain(item[end:]) + tag("endif") + tag("else") + plain(empty) + tag("endfor"))
    return head, text, tail


def pieces(asked):
    """A template of one task in pieces. Pieces with the same index correspond between tasks."""
    base = asked.prompt()
    # The views of agents: `<view>` once per view, each with a label of its own.
    labels = asked.prompt(views=MEMORY).split("<view>")
    before, after = labels[0], labels[-1]
    if base != f"{before}<view>{after}" or len(labels) != MEMORY + 1:
        raise Problem("its list of views is not understood")
    later = [(f"loop.index0 == {n}", plain(labels[n])) for n in range(1, MEMORY)]
    views = tag("for view in views") + choice(later, "") + "{{ view.padded }}\n" + tag("endfor")
    heard_head, heard, heard_tail = listed(asked, "messages", ["<message>"], "messages", ["{{ one }}"])
    offset = asked.entry()
    number = {0: "{{ one.round }}", 1: "{{ one.round_from_1 }}"}.get(offset["round"])
    if number is None:
        raise Problem(f"its history begins with round {offset['round']}")
    action = f"{{{{ one.action or {offset['action']!r} }}}}"
    said = f"{{{{ one.message or {offset['message']!r} }}}}"
    marks = ["<past>", "<action>", "<said>"]
    past_head, past, past_tail = listed(asked, "history", marks, "history", [number, action, said])
    # The part of the text between views and messages that depends on light or load.
    seen = heard_head[len(before) + len("<view>"):]
    off = asked.prompt(state=False)[len(before) + len("<view>"):]
    first, last = ends(seen, off[:len(off) - len(heard_tail)])
    states = [seen[first:len(seen) - last], off[first:len(off) - len(heard_tail) - last]]
    variable = {"Synchronization": "light_on", "Foraging": "carrying_food"}.get(asked.name)
    middle = plain(seen[:first])
    if any(states):
        middle += choice([(variable, plain(states[0]))], plain(states[1])) + plain(seen[len(seen) - last:])
    between = heard_tail[:len(past_head) - len(heard_head)]
    if heard_head + between != past_head or not heard_tail.endswith(past_tail):
        raise Problem("messages and history are not where they were expected")
    return [plain(before), views, middle, heard, plain(between), past, plain(past_tail)]


def joined(templates):
    """One template for all tasks, in which common text occurs once."""
    text = ""
    for parts in zip(*templates.values(), strict=True):
        if len(set(parts)) == 1:
            text += parts[0]
        else:
            cases = [(f'task.name == "{task}"', part) for task, part in zip(templates, parts, strict=True)]
            text += choice(cases[:-1], cases[-1][1])
    return text


def system_message(checkout):
    """The system message: the text that is assigned to `sys_prompt`."""
    tree = ast.parse((checkout / "swarmbench" / "framework.py").read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        is_it = isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "sys_prompt"
        if is_it and isinstance(node.value, ast.Constant):
            return node.value.value
    raise Problem("swarmbench/framework.py assigns no text to sys_prompt")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="the folder of the toolkit")
    parser.add_argument("folder", type=Path, help="where the templates are written")
    args = parser.parse_args()
    try:
        agent, task = modules(args.checkout.resolve())
        check_table(agent)
        templates = {name: pieces(Asking(agent, task, name)) for name in TASKS}
        system = system_message(args.checkout)
    except (Problem, OSError, AttributeError) as error:
        sys.exit(f"error: {error}")
    args.folder.mkdir(parents=True, exist_ok=True)
    # The last line break of a template is dropped.
    for name, parts in templates.items():
        (args.folder / f"{name}.j2").write_text("".join(parts) + "\n", encoding="utf-8")
    (args.folder / "all.j2").write_text(joined(templates) + "\n", encoding="utf-8")
    (args.folder / "system.txt").write_text(system, encoding="utf-8")
    print(f"{len(templates)} templates, all.j2 for all tasks, and system.txt are in {args.folder}")


if __name__ == "__main__":
    main()
