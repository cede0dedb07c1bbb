#!/usr/bin/python3
"""Kills and faults: nothing finished is lost, nothing is run twice, no damaged file is taken for a good one.

    faults.py PROGRAM [--kills N] [--faults N] [--seed N] [--only NAME] [--folder DIR]

Commands are ended at random moments, their files are damaged, limits are set; then the same command goes on, and its
results must be those of an undisturbed run, byte for byte. Prints a table of what was done. Ends with 1 where a promise
was broken, and leaves the folder for a look.
"""
import argparse
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

NOBODY = 65534
PATIENCE = 600  # [s]: a command that has not ended by then hangs
POINTS, SHARDS = 12, 4

# Each point says when it begins, past all buffers, and takes longer than results are gathered (50 ms).
BATCH = """
local tb = require "tribode"
tb.batch { name = "points", seed = 7, count = %d, points = function(i) return { x = i / 10 } end, units = { x = "m" },
  run = function(point, seed, index)
    io.stderr:write("P" .. index .. "\\n")
    local begin = os.clock()
    repeat until os.clock() - begin > %g
    if index == 7 then error("bad luck") end
    return { square = point.x ^ 2, chance = math.random(), list = { index, seed %% 100 } }
  end }
"""
SWEEP = """
local tb = require "tribode"
local sweep = tb.sweep { machine = { rigid_gain_per_kg = 0.1, friction = { viscous = 20 },
  controller = { kp = 20000, kd = 600 } }, frequency_hz = tb.linspace(10, 100, 24), amplitude_N = 10 }
tb.write_csv { file = "sweep.csv", columns = sweep.columns }
tb.write_json { file = "responses.json", value = sweep.responses }
"""
MACHINE = {"rigid_gain_per_kg": 0.1, "friction": {"coulomb": 1, "viscous": 20},
           "controller": {"kp": 20000, "kd": 600}, "encoder_resolution_m": 1e-7}


class Broken(Exception):
    pass


def require(condition, text):
    if not condition:
        raise Broken(text)


class Ending:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err

    def sentence(self):
        """What the program itself says; points write lines of their own."""
        return [line for line in self.err.splitlines() if not re.fullmatch(r"P\d+", line)]

    def begun(self):
        return [int(line[1:]) for line in self.err.splitlines() if re.fullmatch(r"P\d+", line)]

    def check(self, codes, what):
        require(self.code in codes, f"{what}: ended with {self.code}, not one of {codes}: {self.err[-500:]}")
        said = [line for line in self.sentence() if not line.startswith("tribode: warning")]
        if self.code in (0, 75) or self.code < 0:
            return self
        require(len(said) == 1 and said[0].startswith("tribode: "), f"{what}: not one sentence: {self.err[-500:]}")
        return self


class Lab:
    def __init__(self, options):
        self.random = random.Random(options.seed)
        self.folder = Path(tempfile.mkdtemp(prefix="tribode-faults-", dir=options.folder))
        self.folder.chmod(0o755)
        # A build meanwhile changes nothing.
        self.program = Path(shutil.copy2(options.program, self.folder / "tribode"))
        self.table = {}
        self.merged = None  # of an undisturbed batch
        self.kills, self.faults = options.kills, options.faults
        (self.folder / "machine.json").write_text(json.dumps(MACHINE))
        rows = "".join(f"{k * 5e-4:.17g},{1e-3 * min(k / 400, 1):.17g},{(k % 80 < 40) * 8 - 4}\n" for k in range(2000))
        (self.folder / "input.csv").write_text("t,r,exc\n" + rows)
        (self.folder / "batch.lua").write_text(BATCH % (POINTS, 0.06))
        (self.folder / "sweep.lua").write_text(SWEEP)

    def count(self, row, column, number=1):
        line = self.table.setdefault(row, {})
        line[column] = line.get(column, 0) + number

    def start(self, words, limits=(), nobody=False):
        def prepare():
            for kind, value in limits:
                resource.setrlimit(kind, (value, value))
            if nobody and os.geteuid() == 0:
                os.setgroups([])
                os.setgid(NOBODY)
                os.setuid(NOBODY)
        files = [tempfile.TemporaryFile(), tempfile.TemporaryFile()]
        process = subprocess.Popen([str(self.program), *map(str, words), "--quiet"], cwd=self.folder, stdin=subprocess.DEVNULL,
                                   stdout=files[0], stderr=files[1], preexec_fn=prepare)
        process.files = files
        return process

    def finish(self, process):
        try:
            code = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise Broken(f"{' '.join(process.args[1:])} hangs") from None
        texts = []
        for file in process.files:
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
            file.close()
        return Ending(code, *texts)

    def run(self, words, **surroundings):
        return self.finish(self.start(words, **surroundings))

    def timed(self, words):
        begin = time.monotonic()
        ending = self.run(words)
        ending.check([0], " ".join(map(str, words)))
        return time.monotonic() - begin

    def fresh(self, name):
        shutil.rmtree(self.folder / name, ignore_errors=True)
        (self.folder / name).unlink(missing_ok=True) if (self.folder / name).is_file() else None
        return self.folder / name

    def bytes_of(self, folder, leave_out=("manifest.json",)):
        folder = self.folder / folder
        return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*"))
                if f.is_file() and f.name not in leave_out}


def children(process):
    try:
        return [int(n) for n in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


# ---- kills -----------------------------------------------------------------------------------------------------------

def when_nobody_works(lab, batch):
    """The status of the batch. Workers end with the one that started them, as soon as the processor lets them."""
    begin = time.monotonic()
    while True:
        status = json.loads(lab.run(["batch", "status", batch, "--json"]).check([0], "status").out)
        if status["shards"]["active"] == 0:
            return status
        require(time.monotonic() - begin < PATIENCE, f"workers go on without the one that started them: {status}")
        time.sleep(0.01)


def points_kept(lab, batch):
    """The points that are done, from what merge says is missing."""
    status = when_nobody_works(lab, batch)
    lab.fresh("kept.csv")
    ending = lab.run(["batch", "merge", batch, "-o", "kept.csv"])
    if ending.code == 0:
        return set(range(1, POINTS + 1))
    ending.check([2], "merge of an unfinished batch")
    found = re.search(r": (\d+) of \d+ points are missing \(([^;)]*?)(?:; )?\d+ of \d+ shards\)", ending.err)
    require(found, f"merge names what is missing: {ending.err}")
    missing = set()
    for first, last in re.findall(r"(\d+)-(\d+)", found[2]):
        missing |= set(range(int(first), int(last) + 1))
    require(len(missing) == int(found[1]), f"merge counts what it lists: {ending.err}")
    require(status["missing"] == len(missing), f"status and merge agree: {status}, {ending.err}")
    return set(range(1, POINTS + 1)) - missing


class BatchCase:
    """A batch in a folder, gone on with until it is complete; what is kept is never run again."""

    def __init__(self, lab, name="b"):
        self.lab, self.name = lab, name
        self.wanted = None

    def plan(self):
        self.lab.fresh(self.name)
        self.lab.run(["batch", "plan", "batch.lua", "-o", self.name, "--shards", SHARDS]).check([0], "plan")
        self.kept = set()

    def after(self, ending, what):
        """Between two starts."""
        again = self.kept & set(ending.begun())
        require(not again, f"{what}: points {sorted(again)} were kept and were run again")
        kept = points_kept(self.lab, self.name)
        require(self.kept <= kept, f"{what}: points {sorted(self.kept - kept)} are lost")
        self.kept = kept

    def merged(self):
        out = self.lab.fresh(f"{self.name}.h5")
        self.lab.run(["batch", "merge", self.name, "-o", out]).check([0], "merge")
        return out.read_bytes()

    def reference(self):
        if self.lab.merged is None:
            self.plan()
            self.lab.run(["batch", "run", self.name, "-j", 2]).check([0], "run")
            self.lab.merged = self.merged()
        self.wanted = self.lab.merged

    def complete(self, what):
        ending = self.lab.run(["batch", "resume", self.name, "-j", 2]).check([0], f"resume after {what}")
        self.after(ending, f"resume after {what}")
        require(self.merged() == self.wanted, f"{what}: other bytes than of an undisturbed batch")


def kill_batch(lab, kills, how, command):
    case = BatchCase(lab)
    case.reference()
    done = 0
    seconds = POINTS * 0.06
    while done < kills:
        case.plan()
        while done < kills:
            words = ["batch", command, "b", "-j", 2]
            if command == "shard":
                words = ["batch", "shard", "b", lab.random.randint(1, SHARDS)]
            process = lab.start(words)
            time.sleep(lab.random.uniform(0, seconds / 2))
            workers = children(process.pid)
            victim = process.pid
            if how == signal.SIGKILL and workers and lab.random.random() < 0.5:
                victim = lab.random.choice(workers)
            try:
                os.kill(victim, how)
            except ProcessLookupError:
                pass
            ending = lab.finish(process)
            allowed = [0, -signal.SIGKILL] if how == signal.SIGKILL else [0, 3, 75, -how]
            ending.check(allowed, f"{command}, signal {how}")
            # One that is stopped before it has begun to listen ends by the signal, and has begun nothing.
            require(ending.code != -how or how == signal.SIGKILL or not ending.begun(), f"{command}: {how} unheard")
            case.after(ending, f"{command}, signal {how}")
            done += 1
            lab.count(f"batch {command}", signal.Signals(how).name)
            if len(case.kept) == POINTS:
                break
        case.complete("kills")
        require(not list((lab.folder / "b" / "parts").glob("*")), "no attempt is left")


def kill_plan(lab, kills, how, _):
    case = BatchCase(lab)
    case.reference()
    seconds = lab.timed(["batch", "plan", "batch.lua", "-o", lab.fresh("timed"), "--shards", SHARDS])
    for _ in range(kills):
        lab.fresh("b")
        process = lab.start(["batch", "plan", "batch.lua", "-o", "b", "--shards", SHARDS])
        time.sleep(lab.random.uniform(0, seconds))
        process.send_signal(how)
        lab.finish(process).check([0, 2, 3, -how], "plan")
        lab.count("batch plan", signal.Signals(how).name)
        if not (lab.folder / "b" / "manifest.json").exists():
            lab.run(["batch", "run", "b"]).check([2], "a folder without a plan")
            lab.run(["batch", "plan", "batch.lua", "-o", "b", "--shards", SHARDS]).check([0], "plan again")
    case.kept = set()
    case.complete("kills of plan")


def kill_merge(lab, kills, how, _):
    case = BatchCase(lab)
    case.reference()
    case.plan()
    case.complete("nothing")
    for kind in ("csv", "mat", "h5"):
        words = ["batch", "merge", "b", "-o", f"m.{kind}"]
        seconds = lab.timed(words)
        wanted = (lab.folder / f"m.{kind}").read_bytes()
        for _ in range(kills // 3 + 1):
            lab.fresh(f"m.{kind}")
            kill_once(lab, words, how, seconds)
            lab.count("batch merge", signal.Signals(how).name)
            out = lab.folder / f"m.{kind}"
            require(not out.exists() or out.read_bytes() == wanted, f"merge: {out.name} is half a result")
        lab.run(words).check([0], "merge after kills")
        require((lab.folder / f"m.{kind}").read_bytes() == wanted, "merge after kills: other bytes")


def kill_once(lab, words, how, seconds):
    process = lab.start(words)
    time.sleep(lab.random.uniform(0, 1.1 * seconds))
    process.send_signal(how)
    return lab.finish(process).check([0, -how] if how == signal.SIGKILL else [0, 3, -how], " ".join(map(str, words)))


def kill_simulate(lab, kills, how, _):
    words = ["simulate", "--machine", "machine.json", "--input", "input.csv", "-o", "out.csv", "--events", "events.csv"]
    seconds = lab.timed(words)
    wanted = {name: (lab.folder / name).read_bytes() for name in ("out.csv", "events.csv")}
    for _ in range(kills):
        for name in (*wanted, "out.csv.partial.csv"):
            lab.fresh(name)
        kill_once(lab, words, how, seconds)
        lab.count("simulate", signal.Signals(how).name)
        for name, bytes_ in wanted.items():
            there = lab.folder / name
            require(not there.exists() or there.read_bytes() == bytes_, f"simulate: {name} is half a result")
    lab.run(words).check([0], "simulate after kills")
    require((lab.folder / "out.csv").read_bytes() == wanted["out.csv"], "simulate after kills: other bytes")


def kill_sweep(lab, kills, how, _):
    words = ["run", "sweep.lua", "-o", "sweep", "-j", 2]
    lab.fresh("sweep")
    seconds = lab.timed(words)
    wanted = lab.bytes_of("sweep")
    done = 0
    while done < kills:
        lab.fresh("sweep")
        while done < kills:
            ending = kill_once(lab, words, how, seconds)
            lab.count("run (a sweep)", signal.Signals(how).name)
            done += 1
            for name, bytes_ in lab.bytes_of("sweep").items():
                if name == "sweep.resume.json":
                    json.loads(bytes_)
                elif not name.endswith(".part"):
                    require(wanted.get(name) == bytes_, f"sweep: {name} is half a result")
            if ending.code == 0:
                break
        lab.run(words).check([0], "sweep after kills")
        found = {n: b for n, b in lab.bytes_of("sweep").items() if not n.endswith(".part")}
        require(found == wanted, "sweep after kills: other bytes than of an undisturbed one")


def without_seconds(name, bytes_):
    return re.sub(rb'"seconds": [0-9.e+-]+', b"", bytes_) if name == "diagnosis.json" else bytes_


def kill_diagnose(lab, kills, how, _):
    (lab.folder / "real.json").write_text(json.dumps({**MACHINE, "friction": {"coulomb": 1.6, "viscous": 20}}))
    lab.run(["simulate", "--machine", "real.json", "--input", "input.csv", "-o", "real.csv"]).check([0], "simulate")
    words = ["diagnose", "--machine", "machine.json", "--data", "real.csv", "--columns", "t=t,r=r,u=u,y=y", "-o",
             "diagnosis", "--max-effects", 1]
    lab.fresh("diagnosis")
    seconds = lab.timed(words)
    results = ("diagnosis.json", "machine.json", "machine.lua", "validate.csv")
    wanted = {n: without_seconds(n, b) for n, b in lab.bytes_of("diagnosis").items() if n in results}
    for _ in range(kills):
        lab.fresh("diagnosis")
        kill_once(lab, words, how, seconds)
        lab.count("diagnose", signal.Signals(how).name)
        for name, bytes_ in lab.bytes_of("diagnosis").items():
            if name in results:
                require(without_seconds(name, bytes_) == wanted[name], f"diagnose: {name} is half a result")
    lab.run(words).check([0], "diagnose after kills")
    found = {n: without_seconds(n, b) for n, b in lab.bytes_of("diagnosis").items() if n in results}
    require(found == wanted, "diagnose after kills: other results")


# ---- faults ----------------------------------------------------------------------------------------------------------

def full_disk(lab, case):
    """A limit of the size of files, as of a disk that is full, at every size up to that of the result."""
    for _ in range(lab.faults):
        case.plan()
        room = lab.random.randint(1, 1500)
        ending = lab.run(["batch", "run", "b", "-j", 2], limits=[(resource.RLIMIT_FSIZE, room)]).check([0, 1], "run")
        require(ending.code == 0 or "cannot be written" in ending.err, ending.err)
        case.after(ending, "full disk")
        case.complete("a full disk")
        lab.count("batch run", "full disk")
        for kind in ("csv", "mat", "h5"):
            out = lab.fresh(f"full.{kind}")
            ending = lab.run(["batch", "merge", "b", "-o", out], limits=[(resource.RLIMIT_FSIZE, room)])
            ending.check([0, 1], "merge")
            require(ending.code == 0 or not out.exists(), "merge: half a result")
            require(not Path(f"{out}.part").exists(), "merge: a part is left")
            lab.count("batch merge", "full disk")
    for words, out in ((["simulate", "--machine", "machine.json", "--input", "input.csv", "-o", "full.csv"], "full.csv"),
                       (["run", "sweep.lua", "-o", "full"], "full/sweep.csv")):
        for _ in range(lab.faults // 4 + 1):
            lab.fresh("full"), lab.fresh("full.csv")
            room = lab.random.randint(1, 5000)
            ending = lab.run(words, limits=[(resource.RLIMIT_FSIZE, room)]).check([0, 1], words[0])
            require(ending.code == 0 or not (lab.folder / out).exists(), f"{out} is half a result")
            lab.count(words[0] if words[0] == "simulate" else "run (a sweep)", "full disk")
    if Path("/dev/full").exists():
        for words in (["batch", "status", "b"], ["simulate", "--machine", "machine.json", "--input", "input.csv", "-o",
                                                 "full.csv"], ["--version"], ["batch", "merge", "b", "-o", "full.h5"]):
            with open("/dev/full", "wb") as full:
                code = subprocess.run([str(lab.program), *words], cwd=lab.folder, stdout=full,
                                      stderr=subprocess.DEVNULL, check=False).returncode
            require(code == 1, f"{words}: output to a full device ends with {code}")
            lab.count("batch status" if "status" in words else words[0], "full disk")


def no_rights(lab, case):
    """A folder that is read-only, or loses its rights while a batch runs, for one who is not the superuser."""
    if os.geteuid() != 0:
        return
    for place, mode in (("b", 0o555), ("b/shards", 0o555), ("b/parts", 0o555), ("b/shards", 0), ("b/lock", 0o444)):
        for during in (False, True):
            case.plan()
            for path in (lab.folder / "b", *(lab.folder / "b").rglob("*")):
                os.chown(path, NOBODY, NOBODY)
            (lab.folder / "b" / "shards").mkdir(exist_ok=True)
            (lab.folder / "b" / "parts").mkdir(exist_ok=True)
            for path in (lab.folder / "b" / "shards", lab.folder / "b" / "parts"):
                os.chown(path, NOBODY, NOBODY)
            (lab.folder / place).touch() if place == "b/lock" else None
            if not during:
                (lab.folder / place).chmod(mode)
            process = lab.start(["batch", "run", "b", "-j", 2], nobody=True)
            if during:
                time.sleep(lab.random.uniform(0.05, 0.5))
                (lab.folder / place).chmod(mode)
            ending = lab.finish(process).check([0, 1, 2], f"run without rights to {place}")
            (lab.folder / place).chmod(0o755)
            case.after(ending, "lost rights")
            case.complete("lost rights")
            lab.count("batch run", "lost rights" if during else "read-only")


def removed_files(lab, case):
    for _ in range(lab.faults):
        case.plan()
        process = lab.start(["batch", "run", "b", "-j", 2])
        time.sleep(lab.random.uniform(0.05, 0.8))
        kind = lab.random.choice(["parts", "shards", "manifest.json", "points.csv", "lock"])
        place = lab.folder / "b" / kind
        saved = place.read_bytes() if place.is_file() else None
        if place.is_dir():
            for file in place.glob("*"):
                file.unlink(missing_ok=True)
        else:
            place.unlink(missing_ok=True)
        # Without its manifest a folder is no batch: that is said at the end. An attempt that is gone is taken for one that
        # another has taken over, and the run for one that was interrupted.
        lab.finish(process).check([0, 1, 2, 3], f"run while {kind} was removed")
        if saved is not None and not place.exists():
            place.write_bytes(saved)
        case.kept = set()  # those of the removed files
        case.complete(f"{kind} was removed")
        lab.count("batch run", "removed files")


def two_at_once(lab, case):
    for _ in range(lab.faults // 4 + 1):
        case.plan()
        both = [lab.start(["batch", "resume", "b", "-j", 1]) for _ in range(2)]
        endings = [lab.finish(p) for p in both]
        for ending in endings:
            ending.check([0, 2], "two at once")
        begun = sum((e.begun() for e in endings), [])
        require(len(begun) == len(set(begun)), f"two at once: points were run twice: {begun}")
        case.after(Ending(0, "", ""), "two at once")
        case.complete("two at once")
        lab.count("batch resume", "two at once")
        case.plan()
        both = [lab.start(["batch", "shard", "b", 2]) for _ in range(2)]
        for process in both:
            # The one that was taken over leaves the shard to the other.
            lab.finish(process).check([0, 75], "two at one shard")
        case.complete("two at one shard")
        lab.count("batch shard", "two at once")


def flipped(lab, bytes_):
    place = lab.random.randrange(len(bytes_))
    return bytes_[:place] + bytes([bytes_[place] ^ (1 << lab.random.randrange(8))]) + bytes_[place + 1:]


def flipped_bytes(lab, case):
    """A bit of a file that is read back: it is refused, or the result is the same."""
    case.plan()
    case.complete("nothing")
    for name in ("shards/00002.rows", "manifest.json", "points.csv"):
        file = lab.folder / "b" / name
        good = file.read_bytes()
        for _ in range(4 * lab.faults):
            file.write_bytes(flipped(lab, good))
            out = lab.fresh("flipped.h5")
            ending = lab.run(["batch", "merge", "b", "-o", out]).check([0, 2], f"merge with a flipped bit in {name}")
            require(ending.code == 2 or out.read_bytes() == case.wanted, f"{name}: a flipped bit was merged")
            require(ending.code == 0 or not out.exists(), "merge: half a result")
            if name.endswith(".rows"):
                status = lab.run(["batch", "status", "b", "--json"]).check([0, 2], "status")
                whole = status.code == 0 and json.loads(status.out)["complete"]
                require(whole == (ending.code == 0), f"status says complete = {whole}, merge {ending.err}")
                lab.count("batch status", "flipped bits")
            lab.count("batch merge", "flipped bits")
        for _ in range(lab.faults // 2 + 1):
            file.write_bytes(flipped(lab, good))
            ending = lab.run(["batch", "resume", "b", "-j", 2]).check([0, 2], f"resume with a flipped bit in {name}")
            if ending.code == 0:
                require(case.merged() == case.wanted or name == "manifest.json", f"{name}: a flipped bit was kept")
            lab.count("batch resume", "flipped bits")
            file.write_bytes(good)
            require(case.merged() == case.wanted, "the good file again")
    # Attempts: the points before the damage are taken over.
    for _ in range(lab.faults):
        case.plan()
        process = lab.start(["batch", "run", "b", "-j", 2])
        time.sleep(0.5)
        process.kill()
        lab.finish(process)
        for part in (lab.folder / "b" / "parts").glob("*.part"):
            part.write_bytes(flipped(lab, part.read_bytes()))
        case.kept = set()
        case.complete("a flipped bit of an attempt")
        lab.count("batch resume", "flipped bits")
    words = ["run", "sweep.lua", "-o", "sweep", "-j", 2]
    lab.fresh("sweep")
    seconds = lab.timed(words)
    wanted = lab.bytes_of("sweep")
    lab.fresh("sweep")
    checkpoint = lab.folder / "sweep" / "sweep.resume.json"
    while not checkpoint.exists():
        lab.fresh("sweep")
        kill_once(lab, words, signal.SIGINT, seconds)
    kept, manifest = checkpoint.read_bytes(), (lab.folder / "sweep" / "manifest.json").read_bytes()
    for _ in range(lab.faults):
        for name in (checkpoint, lab.folder / "sweep" / "manifest.json"):
            lab.fresh("sweep")
            (lab.folder / "sweep").mkdir()
            checkpoint.write_bytes(kept)
            (lab.folder / "sweep" / "manifest.json").write_bytes(manifest)
            name.write_bytes(flipped(lab, name.read_bytes()))
            ending = lab.run(words).check([0, 2], f"sweep with a flipped bit in {name.name}")
            if ending.code == 0:
                require(lab.bytes_of("sweep") == wanted, f"{name.name}: a flipped bit was taken for a result")
            else:
                require("sweep.csv" not in lab.bytes_of("sweep"), "a result of a refused checkpoint")
            lab.count("run (a sweep)", "flipped bits")


def small_limits(lab, case):
    """Limits of memory, open files, processes: done, or one sentence."""
    simulate = ["simulate", "--machine", "machine.json", "--input", "input.csv", "-o", "limits.csv"]
    lab.run(simulate).check([0], "simulate")
    wanted = (lab.folder / "limits.csv").read_bytes()
    kinds = (("memory", resource.RLIMIT_AS, [2 ** k * 2 ** 20 for k in range(6, 12)]),
             ("open files", resource.RLIMIT_NOFILE, [4, 5, 6, 8, 12, 20]),
             ("processes", resource.RLIMIT_NPROC, [0, 1, 2, 3, 4]))
    os.chmod(lab.folder, 0o777)
    for kind, limit, values in kinds:
        nobody = limit == resource.RLIMIT_NPROC
        if nobody and os.geteuid() != 0:
            continue
        for value in values:
            lab.fresh("limits.csv")
            ending = lab.run(simulate, limits=[(limit, value)], nobody=nobody)
            if not could_start(ending):
                continue
            ending.check([0, 1, 2, 3], f"simulate with {value} {kind}")
            out = lab.folder / "limits.csv"
            require(out.exists() == (ending.code == 0), f"simulate with {value} {kind}: a result and no success")
            require(not out.exists() or out.read_bytes() == wanted, f"simulate with {value} {kind}: another result")
            lab.count("simulate", f"small limits")
            case.plan()
            if nobody:
                for path in (lab.folder / "b", *(lab.folder / "b").rglob("*")):
                    os.chown(path, NOBODY, NOBODY)
            ending = lab.run(["batch", "run", "b", "-j", 2], limits=[(limit, value)], nobody=nobody)
            ending.check([0, 1, 2, 3], f"batch run with {value} {kind}")
            lab.count("batch run", f"small limits")
            # A point may fail for want of memory, and is then a row that says so.
            if limit != resource.RLIMIT_AS or not ending.begun():
                case.after(ending, f"{value} {kind}")
                case.complete(f"{value} {kind}")


def could_start(ending):
    """The loader of shared libraries needs its share of memory and files, too."""
    return "error while loading shared libraries" not in ending.err and not (ending.code < 0 and not ending.err)


KILLS = {"batch run": (kill_batch, 0.2, "run"), "batch resume": (kill_batch, 0.2, "resume"),
         "batch shard": (kill_batch, 0.1, "shard"), "batch plan": (kill_plan, 0.05, None),
         "batch merge": (kill_merge, 0.15, None), "run": (kill_sweep, 0.1, None),
         "simulate": (kill_simulate, 0.15, None), "diagnose": (kill_diagnose, 0.05, None)}
FAULTS = {f.__name__: f for f in (full_disk, no_rights, removed_files, two_at_once, flipped_bytes, small_limits)}


def print_table(table):
    columns = sorted({column for line in table.values() for column in line})
    print("| | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for row in sorted(table):
        print(f"| `{row}` | " + " | ".join(str(table[row].get(c, "")) for c in columns) + " |")
    sums = [sum(line.get(c, 0) for line in table.values()) for c in columns]
    print("| together | " + " | ".join(map(str, sums)) + " |")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("--kills", type=int, default=1000, help="by SIGKILL; a tenth as many by SIGINT and SIGTERM each")
    parser.add_argument("--faults", type=int, default=25, help="of each kind, about")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one command or kind of fault")
    parser.add_argument("--folder", help="where files are put while it runs")
    options = parser.parse_args()
    lab = Lab(options)
    broken = []

    def attempt(name, work):
        if options.only and options.only != name:
            return
        begin = time.monotonic()
        try:
            work()
        except Broken as problem:
            broken.append(name)
            kept = lab.folder.with_name(f"{lab.folder.name}-{len(broken)}")
            shutil.copytree(lab.folder, kept, symlinks=True)
            print(f"BROKEN {name}: {problem}\n  (see {kept})", flush=True)
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for name, (kill, share, command) in KILLS.items():
            for how, part in ((signal.SIGKILL, 1), (signal.SIGINT, 0.1), (signal.SIGTERM, 0.1)):
                kills = max(1, round(options.kills * share * part))
                attempt(name, lambda: kill(lab, kills, how, command))
        if not options.only or options.only in FAULTS:
            case = BatchCase(lab)
            case.reference()
            for name, fault in FAULTS.items():
                attempt(name, lambda: fault(lab, case))
    except KeyboardInterrupt:
        print("ended early: the table is of what was done until then", flush=True)
    print_table(lab.table)
    shutil.rmtree(lab.folder, ignore_errors=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
