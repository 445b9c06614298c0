"""Checks the file of a competition, as docs/journal.md describes it under "The file of a competition".

    python3 verify_competition.py cup.jsonl [COMMITMENT [HEAD]]

The program checks both chains, the commitment, and the seeds, plan, settings and times of all games, counts acts, and
recomputes the board from the final scores. It does not replay rounds, so it believes the scores of the journals: a
replay needs an engine, as `swarmbench verify --competition` has one. Only Python 3.10 or newer is needed.
"""

import hashlib
import json
import math
import struct
import sys
from collections import Counter, defaultdict
from fractions import Fraction
from unicodedata import category

TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"]
# The fields of all objects. Names of optional fields end in a question mark.
FIELDS = {
    "window": "opens_at closes_at", "board": "kind rows", "end of the file": "kind episodes",
    "competition": "kind format id definition created_at revealed_at commitment salt seeds",
    "definition": "name description tasks seeds rules settings idle_timeout_ms opens_at closes_at entry attempts"
    " parallel counts board board_freezes_at? entries_per_key spares? attempts_per_day? public_seeds? tie_breaks?"
    " terms? own_games? categories? seeds_by_task?", "terms": "version text",
    "action": "kind at action subject detail", "change": "field from to",
    "settings": "control num_agents width height view_size memory max_round noise max_delay round_deadline_ms bank_ms"
    " answer_reader?",
    "entrant": "kind id name model temperature? top_p? agent_meta? prompt_template? status reason? vouched"
    " registered_at category? terms?",
    "attempt": "kind entrant attempt replays? run status created_at ended_at voided? games",
    "game": "slot episode voided?", "episode": "kind slot episode lines head",
    "opening": "kind format episode rules_revision created_at config agent_meta prompt_template digest run salt?"
    " prompt_revision?",
    "act": "agent source action message? to? valid failure? response? usage? reasoning? harness? bank_spent_ms?",
    "round": "kind round acts digest score", "end": "kind status reason rounds score open_acts",
}
# The fields that later formats have added, each with the first format that has it.
LATER = {
    "definition": dict.fromkeys("spares attempts_per_day public_seeds tie_breaks terms own_games categories".split(), 2)
    | {"seeds_by_task": 3},
    "entrant": {"category": 2, "terms": 2}, "attempt": {"replays": 2},
}
# The actions after the opening of the results that a file of format 3 contains: all others decide nothing.
AFTER_END = ("attempt.void", "episode.void", "entrant.change", "entrants.exclude")
# The first format in which the status of an attempt fits the ends of its games, and each voided attempt has its action.
FIRST_FORMAT_WITH_CHECKED_ATTEMPTS = 2
ENDINGS = ["finished task_done", "finished rounds_played", "aborted aborted", "aborted closed", "abandoned idle"]


def check(holds, problem):
    if not holds:
        raise ValueError(problem)


def same(what, found, expected):
    check(found == expected, f"{what} is {found!r}, and should be {expected!r}")


def has_fields(name, record, file_format=None):
    fields = FIELDS[name].split()
    wrong = record.keys() - {field.rstrip("?") for field in fields}
    wrong |= {field for field in fields if not field.endswith("?")} - record.keys()
    check(not wrong, f"{name}: these fields are missing, or unknown: {wrong}")
    if file_format:
        later = {field for field, first in LATER.get(name, {}).items() if field in record and file_format < first}
        check(not later, f"{name}: format {file_format} has none of {later}")


def object_of(pairs):
    check(len(dict(pairs)) == len(pairs), "a field stands twice")
    return dict(pairs)


def number_of(text):
    """JSON has no infinite numbers, and nothing that is not a number."""
    check(math.isfinite(float(text)), f"{text} is no number of JSON")
    return float(text)


def shown(text):
    """A text of others, without characters that control a terminal."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


def time(text):
    """The text of a time without the final Z, which has the order of times."""
    check(text.endswith("Z"), f"{text!r} is not a time in UTC")
    return text[:-1]


def in_time(what, at, earliest, end):
    check(time(earliest) <= time(at) < time(end), f"{what} at {at}, not from {earliest} until {end}")


class Reader:
    def __init__(self, file):
        self.file, self.number, self.head = file, 0, bytes(32)
        # The format of the file, which its first record names.
        self.format = None

    def line(self, head):
        """The next record of the chain with this head, and the head after it."""
        line = self.file.readline()
        self.number += 1
        digits, record = line[9:73], line[84:-2]
        check(line == b'{"hash":"' + digits + b'","record":' + record + b"}\n", "not a whole line of such a file")
        head = hashlib.sha256(head + record).digest()
        check(digits == head.hex().encode(), "the line was changed: its hash is another")
        read = {"object_pairs_hook": object_of, "parse_float": number_of, "parse_constant": number_of}
        return json.loads(record, **read), head

    def record(self, *kinds):
        record, self.head = self.line(self.head)
        check(record["kind"] in kinds, f"a record of the kind {record['kind']!r} is out of place")
        has_fields("end of the file" if record["kind"] == "end" else record["kind"], record, self.format)
        return record

    def journal(self, lines):
        head, records = bytes(32), []
        for _ in range(lines):
            record, head = self.line(head)
            records.append(record)
        return records, head.hex()


def check_competition(competition):
    """Returns the plan of each attempt: a task and its seed by the rules for every slot."""
    check(competition["format"] in (1, 2, 3), f"format is {competition['format']!r}, and should be 1 to 3")
    definition = competition["definition"]
    has_fields("definition", definition, competition["format"])
    has_fields("settings", definition["settings"])
    same("the tasks, sorted", sorted(definition["tasks"]), sorted(set(definition["tasks"]) & set(TASKS)))
    check(definition["counts"] in ("best", "last", "first"), "it does not say which attempt counts")
    by_task = definition.get("seeds_by_task", False)
    check(isinstance(by_task, bool), "seeds_by_task is neither true nor false")
    check(0 <= definition.get("public_seeds", 0) < definition["seeds"], "there are no seeds for the final board")
    check(set(definition.get("tie_breaks", [])) <= set(TIE_BREAKS), "a rule for equal totals does not exist")
    if "terms" in definition:
        has_fields("terms", definition["terms"])
    opens_at, closes_at = definition["opens_at"], definition["closes_at"]
    check(max(time(opens_at), time(competition["created_at"])) < time(closes_at), "it closes too early")
    for window in definition["attempts"]:
        has_fields("window", window)
        in_time("a window opens", window["opens_at"], opens_at, window["closes_at"])
        check(time(window["closes_at"]) <= time(closes_at), "a window closes after the competition")
    if competition["revealed_at"] is not None:
        check(time(competition["revealed_at"]) >= time(closes_at), "it was revealed before it closed")
    salt, *sealed = [bytes.fromhex(text) for text in [competition["salt"], *competition["seeds"]]]
    check(len(salt) == 32 and all(len(seed) == 16 for seed in sealed), "salt or seeds have another length")
    count = definition["seeds"]
    same("the number of sealed seeds", len(sealed), count * len(windows_of(definition)))
    same("the commitment", competition["commitment"], hashlib.sha256(salt + b"".join(sealed)).hexdigest())
    attempts = [sealed[first : first + count] for first in range(0, len(sealed), count)]
    return [
        [(task, seed_of(seed, task if by_task else "")) for task in definition["tasks"] for seed in seeds]
        for seeds in attempts
    ]


def seed_of(sealed, task):
    """The seed of the rules that belongs to a sealed one."""
    return int.from_bytes(hashlib.sha256(sealed + task.encode()).digest()[:8], "big") >> 11


def windows_of(definition):
    """The windows of all attempts. Those of spare attempts come last, and are always open."""
    whole = {"opens_at": definition["opens_at"], "closes_at": definition["closes_at"]}
    return definition["attempts"] + [whole] * definition.get("spares", 0)


def ends_of(definition, number, changes):
    """All ends of an attempt's window, each with the time from which it was known."""
    spare = number > len(definition["attempts"])
    field = "closes_at" if spare else f"attempts[{number - 1}].closes_at"
    own = [(at, change) for at, change in changes if change["field"] == field]
    first = own[0][1]["from"] if own else windows_of(definition)[number - 1]["closes_at"]
    return [("", first)] + [(time(at), change["to"]) for at, change in own]


def read_action(record, competition, changes, voids):
    check(competition["format"] > 1, "format 1 has no actions")
    check(isinstance(record["detail"], dict), "the detail of an action is no object")
    revealed_at = competition["revealed_at"]
    if competition["format"] >= 3 and revealed_at is not None and time(record["at"]) >= time(revealed_at):
        check(record["action"] in AFTER_END, f"{record['action']!r} after the end is no part of a file")
    if record["action"] == "attempt.void":
        voids.add((record["subject"], record["detail"]["reason"]))
    if record["action"] == "competition.change":
        for change in record["detail"]["changes"]:
            has_fields("change", change)
            if change["field"].endswith("closes_at"):
                check(time(change["from"]) <= time(change["to"]), "a window was shortened")
            changes.append((record["at"], change))


def check_void(competition, record, voids):
    """Checks that an action of organizers voided a voided attempt, for the same reason."""
    if competition["format"] >= FIRST_FORMAT_WITH_CHECKED_ATTEMPTS and "voided" in record:
        check((record["run"], record["voided"]) in voids, "it was voided, but no action says so")


def check_ending(competition, record, opening, end, ends):
    """Checks that a game of a finished attempt did not close with its window; one that closed before an extension was played."""
    if competition["format"] >= FIRST_FORMAT_WITH_CHECKED_ATTEMPTS and record["status"] == "finished":
        extended = time(opening["config"]["closes_at"]) < time(ends[-1][1])
        check(end["reason"] != "closed" or extended, "it closed with the window of its attempt, and the attempt is finished")


def check_entrant(record, definition):
    check(record["status"] in ("active", "withdrawn", "disqualified"), "an entrant has no status")
    check(not any(category(one) == "Cc" for one in record["name"]), "the name of an entrant has control characters")
    check(record.get("category") in definition.get("categories", [None]), "it has no category of the competition")
    newest = definition.get("terms", {"version": 0})["version"]
    check(record.get("terms", 0) <= newest, "an entrant accepted terms that do not exist")


def check_changes(definition, changes):
    """Checks that each change begins with what the one before made of its field, and that the last ones are the definition."""
    now = {}
    for change in changes:
        same(f"a change of {change['field']} begins", now.get(change["field"], change["from"]), change["from"])
        now[change["field"]] = change["to"]
    ends = {f"attempts[{place}].closes_at": window["closes_at"] for place, window in enumerate(definition["attempts"])}
    for field, value in (definition | ends).items():
        same(f"the last change of {field}", now.get(field, value), value)


class Attempt:
    def __init__(self, record, window, plan, seeds, public=0):
        self.record, self.window = record, window
        # The attempt in whose place this one counts.
        self.number = record.get("replays", record.get("attempt"))
        self.plan = plan
        # The first seeds made the public board. The board of the file is made from the other seeds.
        self.slots = [slot for slot in range(len(plan)) if slot % seeds >= public]
        self.voided = "voided" in record
        self.counts = record["status"] != "running" and not self.voided
        self.void_slots = [game["slot"] for game in record["games"] if "voided" in game and game["slot"] in self.slots]
        # Only of games that count; scores are by slot.
        self.scores, self.acts, self.failures = {}, {"answers": 0, "invalid": 0, "timeouts": 0}, Counter()

    def add(self, slot, rounds, end):
        self.scores[slot] = end["score"]
        for act in [act for record in rounds for act in record["acts"]] + end["open_acts"]:
            has_fields("act", act)
            check("failure" not in act or not act["valid"], "a valid answer has a failure")
            if slot not in self.slots:
                continue
            if act["source"] == "clock":
                self.acts["timeouts"] += 1
                check((act["action"], act["valid"]) == (None, True) and "message" not in act, "the clock does nothing")
            else:
                same("the source of an act", act["source"], "player")
                self.acts["answers"] += 1
                self.acts["invalid"] += not act["valid"]
                self.failures.update([act["failure"]] if "failure" in act else [])

    def task(self, name):
        slots = [slot for slot in self.slots if self.plan[slot][0] == name]
        planned = [slot for slot in slots if slot in self.scores or slot not in self.void_slots]
        planned.sort(key=lambda slot: self.plan[slot][1])
        scores = [self.scores.get(slot, 0.0) for slot in planned]
        mean = added(scores) / len(scores) if scores else None
        squares = added((score - mean) * (score - mean) for score in scores)
        row = {"task": name, "mean": mean, "deviation": math.sqrt(squares / len(scores)) if scores else None}
        games, voided = sum(slot in self.scores for slot in slots), sum(slot in slots for slot in self.void_slots)
        return row | {"games": games, "planned": len(planned), "voided": voided}

    def tasks(self):
        return [self.task(name) for name in TASKS if any(task == name for task, _ in self.plan)]

    def total(self):
        means = [task["mean"] for task in self.tasks()]
        return None if None in means else added(means)


def added(numbers):
    """The sum, rounded after each step: `sum` of Python 3.12 is more exact."""
    total = 0.0
    for number in numbers:
        total += number
    return total


def comparable(total):
    """A key for totals: equal for equal totals, and lowest for null."""
    if total is None:
        return -math.inf
    part, whole = math.modf(total * 1e9)
    return whole + math.copysign(1, part) if abs(part) >= 0.5 else whole


def check_journal(opening, rounds, end, definition, entrant, attempt, game, ends):
    """Checks that a journal belongs in its place."""
    has_fields("opening", opening)
    task, seed = attempt.plan[game["slot"]]
    expected = definition["settings"] | {"task": task, "seed": seed, "start": "now", "visibility": "sealed"}
    expected |= {name: definition[name] for name in ("rules", "idle_timeout_ms")} | {"model": entrant["model"]}
    expected |= {"custom_template": "prompt_template" in entrant, "closes_at": ends[-1][1]}
    # A game keeps the end of the window that was known when the game was opened.
    known = [end for at, end in ends if at <= time(opening["created_at"])]
    if opening["config"].get("closes_at") in known:
        expected["closes_at"] = opening["config"]["closes_at"]
    for name in expected.keys() | opening["config"].keys():
        same(f"the setting {name}", opening["config"].get(name, "missing"), expected.get(name, "missing"))
    meta = entrant.get("agent_meta", {}) | {name: entrant[name] for name in ("temperature", "top_p") if name in entrant}
    same("the kind", opening["kind"], "opening")
    check(opening["format"] in (1, 2), f"the format of a journal is {opening['format']!r}, and should be 1 or 2")
    same("the episode and its run", (opening["episode"], opening["run"]), (game["episode"], attempt.record["run"]))
    same("agent_meta", opening["agent_meta"], meta)
    same("the template", opening["prompt_template"], entrant.get("prompt_template", opening["prompt_template"]))
    in_time("it was created", opening["created_at"], attempt.window["opens_at"], attempt.window["closes_at"])
    for number, record in enumerate(rounds):
        has_fields("round", record)
        same("a record", (record["kind"], record["round"]), ("round", number))
    has_fields("end", end)
    same("the last record and its rounds", (end["kind"], end["rounds"]), ("end", len(rounds)))
    check(f"{end['status']} {end['reason']}" in ENDINGS, "it ends in a way that does not exist")
    same("the final score", end["score"], rounds[-1]["score"] if rounds else end["score"])


def read_attempt(reader, record, competition, plans, entrants, attempts, changes, voids):
    definition, number = competition["definition"], record["attempt"]
    check(record["entrant"] in entrants and 1 <= number <= len(plans), "there is no such entrant, or attempt")
    entrant, window = entrants[record["entrant"]], windows_of(definition)[number - 1]
    ends = ends_of(definition, number, changes)
    same("a spare attempt plays another one again", "replays" in record, number > len(definition["attempts"]))
    attempt = Attempt(record, window, plans[number - 1], definition["seeds"], definition.get("public_seeds", 0))
    runs = [other.record["run"] for own in attempts.values() for other in own]
    check(record["run"] not in runs, "a run is there twice")
    own = attempts[entrant["id"]]
    counted = [other.number for other in own if not other.voided]
    check(attempt.voided or attempt.number not in counted, "an attempt was played twice")
    if "replays" in record:
        check(attempt.number in [other.number for other in own if other.voided], "what it plays again was not voided")
        check(number not in [other.record["attempt"] for other in own], "its spare seeds were used before")
    check(competition["revealed_at"] is None or record["status"] != "running", "it is running after the end")
    check(not (attempt.voided and record["games"]), "it was voided, and has games")
    check_void(competition, record, voids)
    in_time("it was started", record["created_at"], window["opens_at"], window["closes_at"])
    for game in record["games"]:
        has_fields("game", game)
        check(0 <= game["slot"] < len(attempt.plan), "a game has no place in the plan")
        if "voided" in game:
            continue
        check(game["slot"] not in attempt.scores, f"slot {game['slot']} was played twice")
        header = reader.record("episode")
        same("the game", (header["slot"], header["episode"]), (game["slot"], game["episode"]))
        (opening, *rounds, end), head = reader.journal(header["lines"])
        same("the head of the journal", header["head"], head)
        check_journal(opening, rounds, end, definition, entrant, attempt, game, ends)
        check_ending(competition, record, opening, end, ends)
        attempt.add(game["slot"], rounds, end)
    attempts[entrant["id"]].append(attempt)


def name_of_row(entrant):
    parts = [entrant["id"].encode(), entrant["model"].encode()]
    parts += [struct.pack(">d", entrant[name] + 0.0) if name in entrant else b"" for name in ("temperature", "top_p")]
    template = entrant.get("prompt_template", "").encode()
    parts.append(hashlib.sha256(template).hexdigest()[:12].encode() if "prompt_template" in entrant else b"")
    return hashlib.sha256(b"".join(len(part).to_bytes(8, "big") + part for part in parts)).digest()[:16]


def row_of(entrant, own, definition):
    over = [attempt for attempt in own if attempt.counts]
    over.sort(key=lambda attempt: (time(attempt.record["created_at"]), attempt.record["run"].encode()))
    if definition["counts"] == "best":
        over.sort(key=lambda attempt: -comparable(attempt.total()))  # the first of equal attempts stays the first
    attempt = over[-1 if definition["counts"] == "last" else 0] if over else None
    shown = attempt or Attempt({"status": None, "games": []}, None, [], [])
    declared = "declared" if definition["settings"]["control"] == "decentralized" else None
    row = {"rank": None, "entrant": entrant["id"], "decentralization": declared, "run_status": shown.record["status"]}
    row |= {name: shown.record.get(name) for name in ("attempt", "run")}
    row |= {"tasks": shown.tasks(), "total": attempt and attempt.total(), "voided_games": len(shown.void_slots)}
    row |= {"attempts": sum(one.counts for one in own), "voided_attempts": sum(one.voided for one in own)}
    row |= {"failures": dict(shown.failures)} if shown.failures else {}
    return row | shown.acts


def share(part, whole):
    return Fraction(part, whole) if whole else Fraction(0)


TIE_BREAKS = {  # The smaller id is ahead.
    "invalid": lambda row, own: share(row["invalid"], row["answers"]),
    "timeouts": lambda row, own: share(row["timeouts"], row["answers"] + row["timeouts"]),
    "attempts": lambda row, own: sum(not one.voided for one in own),
    "earliest": lambda row, own: next(time(one.record["ended_at"]) for one in own if one.record["run"] == row["run"]),
}


def board(definition, entrants, attempts):
    ranked, waiting, gone = [], [], []
    for entrant in entrants.values():
        row = row_of(entrant, attempts[entrant["id"]], definition)
        if entrant["status"] != "active" or row["attempt"] is None:
            (waiting if entrant["status"] == "active" else gone).append(row)
            continue
        rules = [TIE_BREAKS[name] for name in definition.get("tie_breaks", [])]
        value = (-comparable(row["total"]), [rule(row, attempts[entrant["id"]]) for rule in rules])
        ranked.append((value, entrant["model"].encode(), name_of_row(entrant), row))
    ranked.sort(key=lambda row: row[:3])
    values = [value for value, *_ in ranked]
    for value, _, _, row in ranked:
        row["rank"] = None if row["total"] is None else values.index(value) + 1
    return [row for *_, row in ranked] + waiting + gone


def verify(reader, commitment, head):
    competition = reader.record("competition")
    plans = check_competition(competition)
    reader.format = competition["format"]
    check(commitment in (None, competition["commitment"]), "another commitment was published")
    entrants, attempts, changes, voids = {}, defaultdict(list), [], set()
    while (record := reader.record("action", "entrant", "attempt", "board"))["kind"] != "board":
        if record["kind"] == "action":
            check(not entrants and not attempts, "an action is out of place")
            read_action(record, competition, changes, voids)
        elif record["kind"] == "attempt":
            read_attempt(reader, record, competition, plans, entrants, attempts, changes, voids)
        else:
            check(record["id"] not in entrants and not attempts, "an entrant is out of place")
            check_entrant(record, competition["definition"])
            entrants[record["id"]] = record
    check_changes(competition["definition"], [change for _, change in changes])
    rows = board(competition["definition"], entrants, attempts)
    same("the number of rows", len(record["rows"]), len(rows))
    for place, (published, row) in enumerate(zip(record["rows"], rows, strict=True), 1):
        for name in published.keys() | row.keys():
            same(f"row {place}: {name}", published.get(name, "missing"), row.get(name, "missing"))
    games = sum(len(attempt.scores) for own in attempts.values() for attempt in own)
    same("the number of journals", reader.record("end")["episodes"], games)
    check(not reader.file.readline(), "there is something after the end")
    check(head in (None, reader.head.hex()), f"another file was published: the head of this one is {reader.head.hex()}")
    for row in rows:
        print(row["rank"] or "-", shown(entrants[row["entrant"]]["name"]), row["total"])
    print("the board follows from the scores; the rounds were not played again. Head of the file:", reader.head.hex())
    if commitment is None or head is None:
        print("not proven: that this is what was published, without its commitment and its head")


if __name__ == "__main__":
    path, published_commitment, published_head = [*sys.argv[1:], None, None][:3]
    with open(path, "rb") as opened:
        read = Reader(opened)
        try:
            verify(read, published_commitment, published_head)
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as problem:
            sys.exit(f"line {read.number}: {shown(str(problem))}")
