/* The studio in the browser alone: what plat.studio.session and its panels do, without a server. */
import loadMujoco from "mujoco";
import * as ort from "onnxruntime-web";
import { Chase } from "./chase.mjs";
import { between as poseAround } from "./around.mjs";
import { WAY, verdict } from "./feasibility.mjs";
import { LONGEST_INTERVAL, NEW_INTERVAL, ROOT, Timeline, checkPlace, decoded, mask, read, standing, unitDoubt, write } from "./keyframes.mjs";
import { Policy } from "./policy.mjs";
import { Robot } from "./robot.mjs";
import { conjugate, fromHeadingPitchRoll, headingPitchRoll, multiply } from "./rotations.mjs";
import { Scene } from "./scene.mjs";

const AUTOSAVE = "plat-keyframes", FILE = "plat-keyframes-file", SPEEDS = { "1x": 1, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1 }, CATCH_UP = 5;
const PAUSE = 1000; // ms after which what is done again is another step to undo
const together = (bodies, robot) => (bodies.size ? `, inside each other: ${[...bodies].map((body) => robot.bodyNames[body]).sort().join(", ")}` : "");
const degrees = (radians) => (radians * 180) / Math.PI;
const plain = (value, digits) => (Number(value.toFixed(digits)) + 0).toFixed(digits); // no -0.0
const fill = (input, text) => { if (document.activeElement !== input) input.value = text; };
const wrapped = (turn) => turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));

export async function fetched(path) {
  const response = await fetch(path);
  if (!response.ok) throw new Error(`${path}: ${response.status} ${response.statusText}`);
  return new Uint8Array(await response.arrayBuffer());
}

export async function open(base = ".") {
  const site = JSON.parse(new TextDecoder().decode(await fetched(`${base}/site.json`)));
  if (site.ort) ort.env.wasm.wasmPaths = new URL(site.ort, location.href).href;
  ort.env.wasm.numThreads = 1;
  const robot = new Robot(await loadMujoco(), site), policies = {};
  for (const [number, name] of site.policies.entries()) policies[name] = await Policy.open(ort, `${base}/policies/${number}`, name, robot, fetched);
  return { site, robot, policies };
}

/* Play keyframes at full speed; the robot's poses [T, 7 + J], how far it was from its keyframe [T - 1] (m), and the scores. */
export async function play({ robot, policies, site }, name, text) {
  const timeline = Timeline.of(site, read(text, site)), chase = new Chase(robot, policies[name], timeline.start, timeline.sequence(policies[name].maxSteps));
  while (!chase.finished) await chase.step();
  return { poses: chase.poses, distances: chase.errors.map((error) => error.keypoint), scores: chase.scorer.scores() };
}

/* Copies for the next visit: each tab has its own, and a new one begins with the last of any. */
const STORES = ["sessionStorage", "localStorage"];

function keepCopy({ timeline, name, saved }, stores) {
  const text = timeline.keyframes.length ? write(timeline) : "", file = JSON.stringify({ name, saved });
  for (const store of stores) try { window[store].setItem(AUTOSAVE, text); window[store].setItem(FILE, file); } catch { /* a private window */ }
}

function keptCopy(site) {
  for (const store of STORES) {
    try {
      const text = window[store].getItem(AUTOSAVE);
      if (text !== null) return text ? { ...JSON.parse(window[store].getItem(FILE)), timeline: Timeline.of(site, read(text, site)) } : null;
    } catch { /* a private window, or another robot's */ }
  }
  return null;
}

class Studio {
  constructor(channel, { site, robot, policies }) {
    Object.assign(this, { channel, site, robot, policies });
    this.timeline = new Timeline(site, standing(site));
    this.past = [];
    this.future = [];
    this.gesture = null;
    this.pressed = false; // a keyframe or the slider is dragged: a pause in it ends no step to undo
    this.clipboard = null;
    this.players = [];
    this.runs = 0;
    this.paused = false;
    this.policy = site.policies[0];
    this.second = site.nobody;
    this.speed = "1x";
    this.loop = false;
    this.cursor = 0;
    this.handle = "right hand";
    this.jointNumber = 0;
    this.known = new Map(); // verdicts by what they are of
    this.hidden = false;
    this.onion = true;
    this.notes = [];
    this.name = "keyframes.json";
    this.saved = this.timeline;
    this.scores = {};
    this.told = {}; // by policy, why it did not play when all were compared, or when and why its simulation ended early
    this.busy = []; // what the page waits for
    this.autosave = null; // the timer of a copy that is due
    window.addEventListener("pagehide", () => this.keep());
    this.scene = new Scene(document.querySelector("#root .view"), robot, {
      grab: () => this.grab(), drag: (target) => this.drag(target), release: () => { this.grip = this.turned = this.gesture = null; this.show(); },
      grabJoint: () => { this.gesture = null; this.turned = { selected: this.timeline.selected, quat: this.robot.jointFrame(this.jointNumber, this.timeline.pose.qpos).quat, angle: this.timeline.pose.qpos[7 + this.jointNumber] }; },
      turnJoint: (quat) => this.guarded(() => { if (this.turned.selected !== this.timeline.selected) return; const [w, , , z] = multiply(conjugate(this.turned.quat), quat); this.setJoint(this.turned.angle + wrapped(2 * Math.atan2(z, w))); }),
      choose: (name) => this.guarded(() => { this.handle = name; this.scene.ringed = false; this.show(); }),
      clickBody: (body) => this.guarded(() => this.clickBody(body)),
    });
    this.panel();
    this.actions = this.makeActions();
    channel.receive = (message) => this.guarded(() => this.receive(message));
    channel.open = (file) => this.guarded(async () => this.load(await file.arrayBuffer(), file.name));
  }

  // messages

  note(title, text, kind = "info") {
    this.notes = [...this.notes, { id: (this.notes[this.notes.length - 1]?.id ?? 0) + 1, title, text, kind }].slice(-6);
    this.channel.show({ notes: this.notes });
  }

  guarded(work) {
    const failed = (error) => { console.warn(error); this.note("That did not work", error.message, "error"); };
    try {
      const result = work();
      if (result && result.catch) result.catch(failed);
    } catch (error) { failed(error); }
  }

  receive(message) {
    const action = this.actions[message.do];
    if (!action) return;
    const result = action(message);
    this.show();
    return result;
  }

  makeActions() {
    const edit = (timeline, gesture) => this.edit(timeline, gesture), now = () => this.timeline;
    return {
      toggle: () => this.toggle(), stop: () => this.stop(), step: ({ value }) => this.stepBy(value), speed: ({ value }) => { if (value in SPEEDS) this.speed = value; },
      loop: () => { this.loop = !this.loop; }, select: ({ number }) => this.select(number), previous: () => this.select(now().selected - 1), next: () => this.select(now().selected + 1),
      first: () => this.select(0), last: () => this.select(now().keyframes.length), seek: ({ time }) => this.seek(time),
      retime: ({ number, time }) => edit(now().select(number).retimed(number, time), `time ${number}`),
      nudge: ({ value }) => { const { selected, pose } = now(); if (selected) edit(now().retimed(selected, (now().steps(pose.time) + value) * this.site.control_dt), "nudge"); },
      hold: ({ value }) => edit(now().held(value), "hold"), interval: ({ value }) => edit(now().stretched(value)), rename: ({ value }) => edit(now().renamed([...String(value)].slice(0, 60).join(""))),
      drag: () => this.press(), end: () => this.letGo(), add: ({ time }) => (time === undefined ? this.add() : this.addAt(time)),
      copy: () => this.copy(), cut: () => { const left = now().removed(); this.copy(); edit(left); },
      paste: () => { if (!this.clipboard) throw new Error("nothing to paste: copy a keyframe first"); edit(now().inserted(this.clipboard.pose, NEW_INTERVAL, this.clipboard.hold)); },
      mirror: () => { const { pose } = now(); edit(now().withPose({ ...pose, qpos: this.robot.mirrored(pose.qpos), commands: this.robot.mirroredCommands(pose.commands) })); },
      stand: () => edit(now().posed(this.robot.standing(now().pose.qpos))),
      floor: () => edit(now().posed(this.robot.dropped(now().pose.qpos))), flat: () => edit(now().posed(this.robot.flat(now().pose.qpos))), remove: () => edit(now().removed()),
      around: () => this.leadAround(),
      undo: () => this.swap(this.past, this.future), redo: () => this.swap(this.future, this.past), save: () => this.save(),
      look: () => this.scene.look(this.players[0] && !this.posing ? this.players[0].poseAt(this.cursor) : now().sample(this.cursor).qpos), hide: () => { this.hidden = !this.hidden; },
      onion: () => { this.onion = !this.onion; }, axes: () => this.scene.toggleAxes(), pin: () => this.pin(this.handle),
    };
  }

  // keyframes

  edit(timeline, gesture = null) {
    timeline.poses.forEach(({ qpos }) => checkPlace(qpos));
    if (gesture === null || gesture !== this.gesture) this.past = [...this.past, this.timeline].slice(-500);
    this.gesture = gesture;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => { if (!this.grip && !this.turned && !this.pressed) this.gesture = null; }, PAUSE);
    this.future = [];
    this.replace(timeline);
  }

  /* A keyframe on the way to the selected one, where the straight way leads through the robot itself. */
  leadAround() {
    const [before, after] = this.timeline.way, seconds = after.time - before.time;
    const blocked = verdict(this.robot, before, after, seconds, false).words.find((words) => words.endsWith(WAY));
    if (!blocked) throw new Error("the straight way to this keyframe is clear: there is nothing to lead around");
    const qpos = poseAround(this.robot, before.qpos, after.qpos);
    if (!qpos) throw new Error(`keyframe at ${after.time} s${after.name ? ` ('${after.name}')` : ""}: no way around was found, and ${blocked}: change one of the poses`);
    this.edit(this.timeline.parted(qpos));
  }

  copy() { const { pose, hold } = this.timeline; this.clipboard = { pose, hold }; }

  press() { this.pressed = true; this.gesture = null; }

  letGo() { this.pressed = false; this.gesture = null; }

  replace(timeline) {
    this.timeline = timeline;
    this.end();
    this.scores = {};
    this.told = {};
    this.cursor = timeline.pose.time;
    this.autosave ??= setTimeout(() => this.keep(), 1000);
  }

  /* Keep the keyframes for the next visit, where they were edited since. */
  keep() {
    if (this.autosave === null) return;
    clearTimeout(this.autosave);
    this.autosave = null;
    this.keepNow();
  }

  keepNow() { keepCopy({ timeline: this.timeline, name: this.name, saved: !this.unsaved }, STORES); }

  /* Whether there is anything that no file of the user's holds. */
  get unsaved() { return this.timeline.keyframes.length > 0 && this.timeline.keyframes !== this.saved.keyframes; }

  swap(source, target) {
    this.gesture = null;
    if (!source.length) return;
    target.push(this.timeline);
    this.replace(source.pop());
  }

  select(number) {
    this.gesture = null;
    this.timeline = this.timeline.select(number);
    if (!this.playing) this.cursor = this.timeline.pose.time;
  }

  seek(time) {
    if (this.players.length && !this.finished) this.paused = true;
    this.cursor = Math.min(Math.max(time, 0), Math.max(this.timeline.duration, this.simulated));
    const number = this.timeline.at(this.cursor);
    if (number < 0 || number === this.timeline.selected) return;
    this.gesture = null;
    this.timeline = this.timeline.select(number);
  }

  add() {
    const { timeline } = this;
    if (timeline.shows(this.cursor)) this.edit(timeline.inserted({ ...timeline.pose, name: null }));
    else this.addAt(this.cursor < timeline.duration ? this.cursor : timeline.duration + NEW_INTERVAL);
  }

  /* Add a keyframe at a time (s): interpolated, or after the end in the last pose. Where one is already, or is held, it is selected. */
  addAt(time) {
    const { timeline } = this, last = timeline.select(timeline.keyframes.length);
    const after = time - timeline.duration;
    if (after > LONGEST_INTERVAL + 1e-6) throw new Error(`a keyframe at ${time.toFixed(2)} s would be ${after.toFixed(2)} s after the end, expected at most ${LONGEST_INTERVAL} s`);
    if (after > 1e-6) { this.edit(last.inserted({ ...last.pose, name: null }, after)); return; }
    const added = timeline.insertedAt(time);
    if (added.keyframes === timeline.keyframes) this.select(added.selected); else this.edit(added);
  }

  load(content, name) {
    let timeline;
    try { timeline = Timeline.of(this.site, read(decoded(new Uint8Array(content)), this.site)); } catch (error) { throw new Error(`${name}: ${error.message}`); }
    this.edit(timeline);
    this.saved = timeline;
    this.name = name;
    const doubt = unitDoubt(timeline.keyframes), count = timeline.keyframes.length;
    this.note("Loaded", `${name}: ${count} keyframe${count === 1 ? "" : "s"}${doubt && `; ${doubt}`}`, doubt ? "error" : "good");
    this.show();
  }

  save() {
    if (!this.timeline.keyframes.length) throw new Error("there are no keyframes yet: press A, or add a template");
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([write(this.timeline)], { type: "application/json" }));
    link.download = this.name;
    link.click();
    URL.revokeObjectURL(link.href);
    this.saved = this.timeline;
    this.keepNow();
    this.note("Saved", `${this.name}, among your downloads`, "good");
  }

  template(name) { this.edit(this.continued(name, this.timeline)); }

  /* A timeline with a template's keyframes after the selected pose, the first of them selected. */
  continued(name, timeline) {
    const first = timeline.selected + 1, { qpos } = timeline.pose;
    for (const step of this.site.templates[name]) timeline = timeline.inserted({ time: 0, name: step.name, qpos: this.robot.changed(qpos, step), commands: null }, step.interval, step.hold);
    return timeline.select(first);
  }

  // posing

  get posing() { return !this.playing && this.timeline.shows(this.cursor); }

  grab() {
    this.gesture = null;
    const qpos = this.timeline.pose.qpos, frames = this.robot.frames(qpos);
    const parts = { feet: ["left foot", "right foot"], pelvis: ["pelvis"], chest: /(hand|elbow)$/.test(this.handle) ? ["chest"] : [], hands: ["left hand", "right hand"] };
    const held = Object.entries(parts).flatMap(([part, names]) => (this.at[`hold ${part}`].checked ? names : []));
    this.grip = { selected: this.timeline.selected, rest: qpos, held: Object.fromEntries(held.map((name) => [name, frames[name]])) };
  }

  drag(target) {
    const { grip } = this;
    if (!grip || grip.selected !== this.timeline.selected) return; // a key has selected another pose meanwhile
    this.guarded(() => {
      const { qpos } = this.timeline.pose, symmetric = this.at.symmetric.checked;
      let posed = this.robot.dragged(qpos, this.handle, target, grip.held, grip.rest, this.at.limb.checked || symmetric);
      const side = this.handle.split(" ")[0];
      if (symmetric && ["left", "right"].includes(side)) posed = this.robot.symmetric(posed, side);
      try {
        this.edit(this.timeline.posed(posed), "drag");
        this.show();
      } catch (error) {
        if (!grip.refused) { grip.refused = true; throw error; } // once in a drag
      }
    });
  }

  clickBody(body) {
    const joint = this.site.joint_bodies.indexOf(this.robot.bodyNames[body]);
    if (joint >= 0) this.jointNumber = joint; else this.handle = "pelvis";
    Object.assign(this.scene, { ringed: joint >= 0, arrows: joint < 0 });
    this.show();
  }

  setJoint(value) {
    const qpos = [...this.timeline.pose.qpos], [low, high] = this.site.joint_range[this.jointNumber], name = this.site.joints[this.jointNumber];
    qpos[7 + this.jointNumber] = Math.min(Math.max(value, low), high);
    const side = name.split("_")[0], both = this.at.symmetric.checked && ["left", "right"].includes(side);
    this.edit(this.timeline.posed(both ? this.robot.symmetric(qpos, side) : qpos), `joint ${this.jointNumber}`);
    this.show();
  }

  /* Put the pelvis where the numbers say; what was not touched keeps all its digits. */
  setRoot(touched) {
    const { qpos } = this.timeline.pose, { at } = this, now = headingPitchRoll(qpos.slice(3, 7));
    const root = [..."xyz"].map((axis, index) => qpos[index] + (Number(at[axis].value) - Number(qpos[index].toFixed(3))));
    const asked = ["heading", "pitch", "roll"].map((name) => Number(at[name].value)), same = asked.every((value, index) => value === Number(degrees(now[index]).toFixed(1)));
    const quat = same ? qpos.slice(3, 7) : fromHeadingPitchRoll(asked.map((value) => (value * Math.PI) / 180));
    this.edit(this.timeline.posed([...root, ...quat, ...qpos.slice(7)]), `root ${touched}`);
  }

  get pins() {
    const { pose } = this.timeline, handles = this.site.pins;
    if (!mask(pose, this.site)) return new Set([...Object.keys(handles), "pelvis", "head", "whole robot"]);
    const pinned = Object.keys(handles).filter((name) => (pose.commands.bodies || []).includes(handles[name]));
    return new Set([...pinned, ...((pose.commands.root || []).length ? ["pelvis"] : [])]);
  }

  /* Command a handle or take its pin out; what else the keyframe commands stays. Without any the whole pose is commanded. */
  pin(name) {
    const { pose } = this.timeline, body = this.site.pins[{ head: "chest" }[name] ?? name];
    const { joints = [], bodies = [], root = [] } = mask(pose, this.site) ? pose.commands : {};
    const parts = { joints, bodies: !body ? bodies : bodies.includes(body) ? bodies.filter((one) => one !== body) : [...bodies, body], root: body ? root : root.length ? [] : ROOT };
    const named = Object.entries(parts).filter(([, names]) => names.length);
    this.edit(this.timeline.commanding(named.length ? Object.fromEntries(named) : null));
  }

  faint() {
    const { pose } = this.timeline, { bodies } = this.robot;
    if (!mask(pose, this.site)) return new Set();
    const { joints = [], bodies: named = [], root = [] } = pose.commands;
    const kept = new Set([...named.map((name) => bodies[name]), ...joints.map((name) => bodies[this.site.joint_bodies[this.site.joints.indexOf(name)]]), ...(root.length ? [this.robot.keypoints[0]] : [])]);
    return new Set(Object.values(bodies).filter((body) => !kept.has(body)));
  }

  /* What is doubtful about the start: a robot at rest must be able to stay in it. */
  startVerdict() {
    const { start } = this.timeline, key = String(start.qpos);
    if (this.knownStart?.key !== key) this.knownStart = { key, verdict: verdict(this.robot, start, start, 1, true) };
    return this.knownStart.verdict;
  }

  /* What is doubtful about each keyframe, and its fastest joint; those that are held or repeated, and the last one, must be balanced. */
  verdicts() {
    const { keyframes, holds, ways } = this.timeline, known = new Map(), parts = (frame) => String(mask(frame, this.site));
    const repeats = (frame, after) => parts(frame) === parts(after) && after.qpos.every((value, at) => Math.abs(value - frame.qpos[at]) <= 1e-6 + 1e-5 * Math.abs(value));
    const result = ways.map(([before, frame], index) => {
      const seconds = Math.round((frame.time - before.time) * 1e6) / 1e6, after = keyframes[index + 1], held = holds[index] > 0 || !after || repeats(frame, after);
      const key = [before.qpos, frame.qpos, parts(frame), seconds, held].join("|"); // not the keyframe, which an edit of another one makes anew
      const found = this.known.get(key) ?? verdict(this.robot, before, frame, seconds, held);
      known.set(key, found);
      return found;
    });
    this.known = known;
    return result;
  }

  // playing

  get finished() { return this.players.every((player) => player.finished); }
  get playing() { return this.players.length > 0 && !this.finished && !this.paused; }
  get simulated() { return Math.max(0, ...this.players.map((player) => player.time)); }

  end() {
    this.players.forEach((player) => player.end());
    this.players = [];
    this.paused = false;
  }

  stop() { this.end(); this.cursor = 0; this.timeline = this.timeline.select(0); }

  start() {
    const names = [this.policy, ...(this.second === this.site.nobody ? [] : [this.second])];
    const players = names.map((name) => new Chase(this.robot, this.policies[name], this.timeline.start, this.timeline.sequence(this.policies[name].maxSteps)));
    this.end();
    this.scores = {};
    this.told = {};
    this.players = players;
    this.cursor = 0;
  }

  toggle() {
    if (this.playing) { this.paused = true; return; }
    if (this.players.length && !this.finished) { this.paused = false; this.cursor = this.simulated; } else this.start();
    return this.run();
  }

  async run() {
    // who pauses and goes on within a frame begins another run, before this one has seen that it ended
    const { players } = this, own = ++this.runs, live = () => this.players === players && this.runs === own;
    let last = performance.now(), ahead = 0;
    while (this.playing && live()) {
      await new Promise(requestAnimationFrame);
      const now = performance.now();
      ahead += ((now - last) / 1000) * SPEEDS[this.speed];
      last = now;
      let due = Math.floor(ahead / this.site.control_dt + 1e-9);
      ahead = due <= CATCH_UP ? ahead - due * this.site.control_dt : 0;
      for (due = Math.min(due, CATCH_UP); due > 0 && this.playing && live(); due--) await this.forward();
      if (!live()) return;
      if (this.playing || this.finished) this.cursor = this.simulated; // else someone paused it elsewhere
      if (this.playing) this.showMoving();
    }
    if (live() && this.finished && this.loop) { this.start(); return this.run(); }
    this.show();
  }

  /* Score all policies on the keyframes as they are, at full speed. */
  async compare() {
    if (this.comparing) return;
    const { timeline, site } = this, results = {}, told = {};
    timeline.sequence(site.max_steps); // that there is something to play
    this.comparing = true;
    try {
      for (const name of site.policies) {
        this.busy = [`Playing ${name} at full speed …`];
        this.show();
        try { this.take(await this.chased(name, timeline), name, results, told); } catch (error) { told[name] = `did not play: ${error.message}`; }
      }
      if (this.timeline.keyframes === timeline.keyframes && this.timeline.start === timeline.start) Object.assign(this, { scores: results, told });
    } finally {
      this.comparing = false;
      this.busy = [];
      this.show();
    }
  }

  async chased(name, timeline) {
    const policy = this.policies[name], chase = new Chase(this.robot, policy, timeline.start, timeline.sequence(policy.maxSteps));
    while (!chase.finished) {
      if (chase.taken % 10 === 0) await new Promise((done) => setTimeout(done)); // the page lives on
      await chase.step();
    }
    return chase;
  }

  /* Take the scores of a policy's chase, and when and why it ended early, if it did. */
  take(chase, name, scores, told) {
    scores[name] = chase.scorer.scores();
    if (chase.ended) told[name] = chase.ended;
  }

  async forward() {
    const players = this.players;
    for (const player of players) if (!player.finished) await player.step();
    players.forEach((player, index) => { if (player.finished && this.players === players) this.take(player, index ? this.second : this.policy, this.scores, this.told); });
  }

  async stepBy(count) {
    if (!this.players.length) this.start();
    this.paused = true;
    const goal = Math.max(this.timeline.steps(this.cursor) + count, 0) * this.site.control_dt;
    while (this.simulated + 1e-9 < goal && !this.finished) await this.forward();
    this.cursor = Math.min(goal, this.simulated);
    this.show();
  }

  // the page

  panel() {
    const make = (tag, attributes = {}, ...children) => {
      const element = document.createElement(tag);
      for (const [name, value] of Object.entries(attributes)) if (name in element) element[name] = value; else element.setAttribute(name, value);
      element.append(...children);
      return element;
    };
    const at = (this.at = {}), row = (label, ...inputs) => make(inputs.length > 1 || inputs[0].type === "button" ? "div" : "label", { className: "row" }, make("span", { textContent: label }), ...inputs);
    const select = (name, options, done) => (at[name] = make("select", { ariaLabel: name, onchange: () => this.guarded(() => { done(at[name].value); this.show(); }) }, ...options.map((text) => make("option", { textContent: text, value: text }))));
    const button = (text, done) => make("button", { type: "button", textContent: text, onclick: () => this.guarded(() => { const result = done(); this.show(); return result; }) });
    const check = (name, checked = false) => (at[name] = make("input", { type: "checkbox", ariaLabel: name, checked }));
    const ticked = (part) => make("label", { className: "tick" }, check(`hold ${part}`, part !== "hands"), part);
    const { site } = this;
    at.slider = make("input", { type: "range", step: 0.01, ariaLabel: "joint angle", oninput: () => this.setJoint(Number(at.slider.value)), onpointerdown: () => this.press(), onpointerup: () => this.letGo(), onpointercancel: () => this.letGo(), onchange: () => this.letGo() });
    at.angle = make("output");
    at.file = make("input", { type: "file", accept: ".json,application/json", hidden: true, onchange: () => { const file = at.file.files[0]; at.file.value = ""; if (file) this.channel.open(file); } });
    at.scores = make("div", { className: "scores" });
    const number = (name, step, done) => (at[name] = make("input", { type: "number", step, ariaLabel: name, onkeydown: (event) => { if (event.key === "Enter") event.target.blur(); }, onchange: () => this.guarded(() => { try { if (at[name].value !== "") done(); } finally { this.show(); } }) }));
    const place = [..."xyz"].map((axis) => number(axis, 0.01, () => this.setRoot(axis))), turn = ["heading", "pitch", "roll"].map((name) => number(name, 1, () => this.setRoot(name)));
    // a box that shows a choice for which there is a key
    const shows = (name, key, done) => make("label", { className: "tick", title: `Key: ${key}` }, Object.assign(check(name), { onchange: () => this.guarded(() => { done(at[name].checked); this.show(); }) }), name);
    document.querySelector("#root aside").append(
      make("h1", { textContent: "plat keyframe studio" }),
      row("Policy", select("policy", site.policies, (value) => { this.policy = value; this.end(); })),
      row("Beside it", select("second", [site.nobody, ...site.policies], (value) => { this.second = value; this.end(); })),
      row("Begin with", select("template", Object.keys(site.templates), () => {}), button("Add", () => this.template(at.template.value)), button("New", () => { this.edit(new Timeline(site, standing(site))); })),
      row("File", button("Load", () => at.file.click()), button("Save", () => this.save()), at.file),
      make("hr"),
      row("Drag by", select("handle", Object.keys(site.handles), (value) => { this.handle = value; Object.assign(this.scene, { arrows: true, ringed: false }); })),
      row("Commands", select("commands", [...Object.keys(site.presets), "what is pinned"], (value) => { if (value in site.presets) this.edit(this.timeline.commanding(site.presets[value])); })),
      row("Joint", select("joint", site.joints, (value) => { this.jointNumber = site.joints.indexOf(value); Object.assign(this.scene, { arrows: false, ringed: true }); })),
      row("", at.slider, at.angle),
      row("One limb only", check("limb")), row("Symmetric", check("symmetric")),
      row("Hold", ...["feet", "pelvis", "chest", "hands"].map(ticked)),
      row("Pelvis (m)", ...place), row("turned (deg)", ...turn),
      row("Show", shows("neighbors", "O", (on) => { this.onion = on; }), shows("robot", "H", (on) => { this.hidden = !on; }), shows("world axes", "W", () => this.scene.toggleAxes())),
      row("Way", button("Lead around", () => this.actions.around())),
      row("Put", button("On floor", () => this.actions.floor()), button("Feet flat", () => this.actions.flat()), button("Standing", () => this.actions.stand())),
      make("hr"), row("Follow it", Object.assign(check("follow", true), { onchange: () => this.show() })),
      button("Compare all policies", () => this.compare()), at.scores,
      make("p", { className: "more", textContent: "Motion clips, a library of poses, videos and experts need the page with a server: install plat with its extra studio, then run plat studio." }),
    );
  }

  placedOf(qpos) { return qpos ? this.robot.placed(qpos) : null; }

  showMoving() {
    const { timeline, cursor, posing, playing, robot } = this, { figures } = this.scene, [first, second] = this.players;
    const shown = (player) => (player && (playing || !this.hidden) ? player.poseAt(cursor) : null);
    const goal = (player) => (player && !posing && cursor > 0 ? player.commandAt(cursor).qpos : null);
    const between = !playing && !posing && !first, pose = posing ? timeline.pose.qpos : between ? timeline.sample(cursor).qpos : null;
    figures.robot.show(this.placedOf(shown(first)));
    figures.second.show(this.placedOf(shown(second)));
    figures.goal.show(this.placedOf(goal(first)));
    figures.goal2.show(this.placedOf(goal(second)));
    const { inside, sunk } = pose ? robot.contacts(pose) : {};
    figures.pose.show(this.placedOf(pose), { color: between ? 0x96aaa0 : undefined, faint: posing ? this.faint() : undefined, inside });
    const neighbor = (away) => (posing && this.onion && timeline.poses[timeline.selected + away] ? timeline.poses[timeline.selected + away].qpos : null);
    figures.before.show(this.placedOf(neighbor(-1)), { beside: this.placedOf(pose) });
    figures.after.show(this.placedOf(neighbor(1)), { beside: this.placedOf(pose) });
    const stance = pose ? robot.stance(pose) : null;
    this.scene.showStance(stance);
    const away = first && !posing && this.at.follow.checked ? [0, 1].map((axis) => first.poseAt(cursor)[axis] - timeline.start.qpos[axis]) : [0, 0];
    this.scene.world.position.set(-away[0], -away[1], 0);
    const mode = playing ? "playing" : first && !this.finished ? "paused" : "still";
    this.channel.show({ time: { cursor, simulated: this.simulated, mode, speed: this.speed, loop: this.loop }, check: stance ? (sunk > this.site.limits.floor_penetration ? `${(100 * sunk).toFixed(0)} cm inside the floor` : stance.words) + together(inside, robot) : "", distances: { dt: this.site.control_dt, of: this.players.map((player) => player.errors.map((error) => error.keypoint)) } });
    this.scene.draw();
  }

  show() {
    const { timeline, site, at } = this, found = [this.startVerdict(), ...this.verdicts()], scores = this.scores[this.policy] || [], { qpos } = timeline.pose;
    const poses = timeline.poses.map((pose, number) => {
      const own = scores.filter((score) => score.number === number && (score.status === "fell" || !this.onTheWay(score)));
      const worst = ["fell", "late", "reached"].map((status) => own.find((score) => score.status === status)).find(Boolean);
      return { time: pose.time, hold: number ? timeline.holds[number - 1] : 0, label: timeline.labels[number], name: pose.name || "", ...found[number], status: worst?.status ?? "waiting", result: worst?.words ?? "" };
    });
    const arrivals = new Set(timeline.toKeyframes().map((frame) => frame.time));
    const marks = timeline.keyframes.length ? timeline.sequence(this.policies[this.policy].maxSteps).filter((frame) => !arrivals.has(frame.time)).map((frame) => frame.time) : [];
    this.channel.show({
      timeline: { poses, selected: timeline.selected, interval: timeline.interval, duration: timeline.duration, marks, longest: LONGEST_INTERVAL, undo: this.past.length > 0, redo: this.future.length > 0, paste: this.clipboard !== null },
      file: { name: this.name, unsaved: this.unsaved, autosave: "" }, busy: this.busy,
    });
    this.scene.showHandles(this.robot.frames(qpos), this.handle, this.pins, this.posing, this.robot.jointFrame(this.jointNumber, qpos));
    at.handle.value = this.handle;
    const parts = (commands) => String(mask({ commands }, site)), now = parts(timeline.pose.commands);
    at.commands.value = Object.keys(site.presets).find((name) => parts(site.presets[name]) === now) ?? "what is pinned";
    at.commands.disabled = timeline.selected === 0;
    at.joint.value = site.joints[this.jointNumber];
    [at.slider.min, at.slider.max] = site.joint_range[this.jointNumber];
    at.slider.value = qpos[7 + this.jointNumber];
    const turned = headingPitchRoll(qpos.slice(3, 7));
    [..."xyz"].forEach((axis, index) => fill(at[axis], plain(qpos[index], 3)));
    ["heading", "pitch", "roll"].forEach((name, index) => fill(at[name], plain(degrees(turned[index]), 1)));
    Object.entries({ neighbors: this.onion, robot: !this.hidden, "world axes": this.scene.worldAxes }).forEach(([name, on]) => { at[name].checked = on; });
    at.angle.textContent = `${qpos[7 + this.jointNumber].toFixed(2)} rad`;
    this.showScores();
    this.showMoving();
  }

  /* Whether a score is of a pose at which a long interval is split: nobody drew it, and of it counts a fall. */
  onTheWay({ number, time }) { return this.timeline.steps(time) < this.timeline.steps(this.timeline.poses[number].time); }

  showScores() {
    const table = (name, scores) => {
      const rows = scores.map((score) => [(this.onTheWay(score) ? "way to " : "") + this.timeline.labels[score.number], score.words, score.joint === null ? "-" : score.joint.toFixed(3), score.keypoint === null ? "-" : (1000 * score.keypoint).toFixed(0)]);
      const element = document.createElement("table");
      for (const cells of [[name, "outcome", "joints rad", "keypoints mm"], ...rows]) {
        const line = element.insertRow();
        for (const text of cells) line.insertCell().textContent = text;
      }
      return element;
    };
    const told = Object.entries(this.told).map(([name, words]) => Object.assign(document.createElement("p"), { textContent: `${name} ${words}` }));
    this.at.scores.replaceChildren(...Object.entries(this.scores).map(([name, scores]) => table(name, scores)), ...told);
    if (!this.at.scores.childElementCount) this.at.scores.textContent = "Press Play (space) to see what the policy makes of the keyframes.";
  }
}

/* Fill the page. */
export async function begin(channel) {
  const words = (title, text) => { const [head, rest] = document.querySelectorAll("#dock-cover b, #dock-cover span:last-child"); head.textContent = title; rest.textContent = text; };
  try {
    if (window.platBlind) throw new Error(window.platBlind);
    words("plat keyframe studio", "Loading physics and policy, some 30 MB …");
    const studio = new Studio(channel, await open());
    const kept = keptCopy(studio.site);
    studio.timeline = kept?.timeline ?? studio.continued(Object.keys(studio.site.templates)[0], studio.timeline);
    if (kept) keepCopy(kept, [STORES[0]]); // now also this tab's
    studio.name = kept?.name ?? studio.name;
    if (kept?.saved ?? true) studio.saved = studio.timeline;
    studio.cursor = studio.timeline.pose.time;
    studio.show();
    if (kept) studio.note("Restored", "These are the keyframes of your last visit. New, and Add, begin anew.");
    window.platStudio = studio;
  } catch (error) {
    console.error(error);
    words("The studio could not be loaded.", error.message);
  }
}
