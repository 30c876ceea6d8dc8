/* Keyframes: files, edits of a timeline, and the sequence that is played. The same rules as plat.keyframes and
   plat.studio.timeline, by which they are tested. */
import { slerp } from "./rotations.mjs";

export const LONGEST_INTERVAL = 30, NEW_INTERVAL = 0.6;
export const ROOT = ["horizontal", "height", "orientation"];
const HOLD = "(hold)";
const round = (value) => Math.round(value * 1e6) / 1e6;

/* The control step nearest to a time (s); in the middle the even one, as Python rounds. */
export function nearestStep(time, site) {
  const steps = time / site.control_dt, below = Math.floor(steps), rest = steps - below;
  return rest < 0.5 || (rest === 0.5 && below % 2 === 0) ? below : below + 1;
}

/* A keyframe is { time, name, qpos: [7 + J], commands: null or { joints, bodies, root } of names }. */
export const standing = (site) => ({ time: 0, name: null, qpos: [...site.default_qpos], commands: null });

export function interpolate(before, after, time) {
  const weight = (time - before.time) / (after.time - before.time);
  const qpos = before.qpos.map((value, index) => value + weight * (after.qpos[index] - value));
  const quat = slerp(before.qpos.slice(3, 7), after.qpos.slice(3, 7), weight);
  return { time, name: null, commands: null, qpos: [...qpos.slice(0, 3), ...quat, ...qpos.slice(7)] };
}

/* Mask [J + K + 3] of what is commanded; null for a whole pose. */
export function mask(keyframe, site) {
  if (!keyframe.commands) return null;
  const { joints = [], bodies = [], root = [] } = keyframe.commands;
  const flags = (names, chosen) => names.map((name) => (chosen.includes(name) ? 1 : 0));
  const all = [...flags(site.joints, joints), ...flags(site.keypoints, bodies), ...flags(ROOT, root)];
  return all.every(Boolean) ? null : all;
}

/* A keyframe with what it does not command of its root as in the one before it. */
export function withCommandedRoot(before, after, site) {
  const flags = mask(after, site);
  if (!flags) return after;
  // the root is the first of the bodies
  const [horizontal, height, orientation] = flags.slice(-3), root = flags[site.joints.length], place = [horizontal || root, horizontal || root, height || root];
  const commanded = [...place, ...Array(4).fill(orientation)];
  return { ...after, qpos: after.qpos.map((value, index) => (index >= 7 || commanded[index] ? value : before.qpos[index])) };
}

/* A keyframe with its root where the robot probably is at the arrival: as it is drawn where bodies are commanded. */
export const asArrived = (before, after, site) => (after.commands?.bodies?.length ? after : withCommandedRoot(before, after, site));

/* What is at a time between poses, or the one at the end that is nearest. */
export function between(poses, time) {
  const after = poses.findIndex((pose) => pose.time > time);
  return after < 1 ? poses[after < 0 ? poses.length - 1 : 0] : interpolate(poses[after - 1], poses[after], time);
}

/* The start and all keyframes, each changed by what came before it. */
export const following = (change, start, frames, site) => frames.reduce((poses, frame) => [...poses, change(poses[poses.length - 1], frame, site)], [start]);

// no robot's root is this far above or below the floor (m); how far a quaternion may be from unit length; a day (s)
const HIGHEST = 5, FARTHEST = 1000, UNIT = 1e-2, LONGEST = 86400;
const LONG = 10; // seconds between keyframes that are hardly meant

/* A number with some digits, as Python's :g writes it. */
export function general(value, digits = 6) {
  const [factor, power] = value.toExponential(digits - 1).split("e");
  if (power >= -4 && power < digits) return String(Number(value.toPrecision(digits)));
  return `${Number(factor)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

/* Refuse a root where no robot in meters can be. */
export function checkPlace(place, label = "") {
  if (Math.abs(place[2]) > HIGHEST) throw new Error(`${label}root_pos puts the root at a height of ${general(place[2])} m, expected meters, at most ${HIGHEST}; is it in centimeters or millimeters?`);
  const farthest = Math.max(Math.abs(place[0]), Math.abs(place[1]));
  if (farthest > FARTHEST) throw new Error(`${label}root_pos puts the root ${general(farthest)} m away from the origin, expected meters, at most ${FARTHEST}`);
}

const POSE = ["root_pos", "root_quat", "joint_pos"];

function shown(value) {
  if (typeof value === "number" && !Number.isFinite(value)) return String(value).toLowerCase().replace("infinity", "inf"); // JSON would say null
  const text = JSON.stringify(value) ?? "nothing";
  return text.length > 60 ? `${text.slice(0, 59)}…` : text;
}

const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

function fields(entry, required, optional, label) {
  const missing = required.find((field) => !(field in entry)), unknown = Object.keys(entry).find((field) => ![...required, ...optional].includes(field));
  if (missing) throw new Error(`${label}${missing} is missing`);
  if (unknown !== undefined) throw new Error(`${label}unknown field ${shown(unknown)}, expected ${[...required, ...optional].join(", ")}`);
}

function number(value, field) {
  if (typeof value !== "number" || !Number.isFinite(value)) throw new Error(`${field} is ${shown(value)}, expected a finite number`);
  return value;
}

function numbers(value, size, field) {
  if (!Array.isArray(value) || value.length !== size) throw new Error(`${field} is ${shown(value)}, expected a list of ${size} finite numbers`);
  return value.map((one, index) => number(one, `${field}[${index}]`));
}

function jointAngles(content, site, label) {
  if (!isObject(content)) throw new Error(`${label}: joint_pos: expected an object of joint names and angles`);
  // robots' own files say left_knee_joint
  const twice = site.joints.find((name) => name in content && `${name}_joint` in content);
  if (twice) throw new Error(`${label}: joint_pos: '${twice}_joint' and '${twice}' are one joint, expected one of them`);
  const angles = Object.fromEntries(Object.entries(content).map(([name, angle]) => [jointCalled(name, site), angle]));
  const missing = site.joints.find((name) => !(name in angles)), unknown = Object.keys(angles).find((name) => !site.joints.includes(name));
  if (missing || unknown !== undefined)
    throw new Error(`${label}: joint_pos: ${missing ? `missing joint ${missing}` : `unknown joint ${shown(unknown)}`}, expected the ${site.joints.length} of ${site.robot}`);
  const found = site.joints.map((name) => number(angles[name], `${label}: joint_pos: '${name}'`));
  const excess = found.map((angle, joint) => Math.max(site.joint_range[joint][0] - angle, angle - site.joint_range[joint][1]));
  const most = Math.max(...excess), worst = excess.indexOf(most), [low, high] = site.joint_range[worst].map((limit) => general(limit, 4));
  if (most > 1e-3) {
    const doubt = found.some((angle) => Math.abs(angle) > 2 * Math.PI) ? ": in degrees?" : "";
    throw new Error(`${label}: joint_pos: '${site.joints[worst]}' is ${general(found[worst], 4)} rad, expected ${low} to ${high} (its range)${doubt}`);
  }
  return found;
}

function commanded(content, site, label) {
  const known = { joints: site.joints, bodies: site.keypoints, root: ROOT };
  if (!isObject(content)) throw new Error(`${label}: commands is ${shown(content)}, expected an object of lists of names`);
  fields(content, [], Object.keys(known), `${label}: commands: `);
  for (const [field, names] of Object.entries(content)) {
    if (!Array.isArray(names) || !names.every((name) => typeof name === "string")) throw new Error(`${label}: commands: ${field} is ${shown(names)}, expected a list of names`);
    const unknown = names.find((name) => !known[field].includes(field === "joints" ? jointCalled(name, site) : name));
    if (unknown !== undefined) throw new Error(`${label}: commands: ${field} has ${shown(unknown)}, expected some of ${known[field].join(", ")}`);
  }
  if (!Object.values(content).some((names) => names.length)) throw new Error(`${label}: commands: nothing is commanded, expected a joint, a body or a part of the root`);
  return content.joints ? { ...content, joints: content.joints.map((name) => jointCalled(name, site)) } : content;
}

function jointCalled(name, site) {
  const plain = name.replace(/_joint$/, "");
  return !site.joints.includes(name) && site.joints.includes(plain) ? plain : name;
}

/* What the times may be where no policy could keep any of them; empty where one may be a slip. */
export function unitDoubt(frames) {
  const doubtful = frames.every(({ time }, index) => time - (index ? frames[index - 1].time : 0) > LONG);
  return doubtful ? "times are in seconds: are these milliseconds or frames?" : "";
}

const MOST_BYTES = 2 ** 25, DEEPEST = 500; // of a file

/* The text of a file, in an encoding of JSON, told as Python tells it: by where the null bytes are. */
export function decoded(bytes) {
  if (bytes.length > MOST_BYTES) throw new Error(`${(bytes.length / 1e6).toFixed(0)} MB, expected at most ${(MOST_BYTES / 1e6).toFixed(0)} MB`);
  const [first, second] = bytes, wide = (first === 0xff && second === 0xfe) || (first && second === 0) ? "utf-16le" : (first === 0xfe && second === 0xff) || first === 0 ? "utf-16be" : "utf-8";
  try { return new TextDecoder(wide, { fatal: true }).decode(bytes); } catch { throw new Error(`not a readable JSON file (its bytes are no ${wide.toUpperCase()})`); }
}

/* Refuse what JSON.parse takes and Python's reader does not: a field that comes twice, and halves of characters. */
function checkFields(text) {
  const open = []; // the fields so far of each object that is open; null for a list
  for (const [token, string, colon] of text.matchAll(/("[^"\\]*(?:\\.[^"\\]*)*")(\s*:)?|[[\]{}]/g)) {
    if (token === "{" || token === "[") open.push(token === "{" ? new Set() : null);
    else if (token === "}" || token === "]") open.pop();
    else {
      const value = JSON.parse(string), known = open[open.length - 1];
      if (/\p{Surrogate}/u.test(value)) throw new Error("half of a surrogate pair in a text, expected whole characters");
      if (colon && known.has(value)) throw new Error(`field ${shown(value)} comes twice in one object`);
      if (colon) known.add(value);
    }
    if (open.length > DEEPEST) throw new Error("not a readable JSON file (nested too deeply)");
  }
}

const STRING = /"[^"\\]*(?:\\.[^"\\]*)*"/.source, NO_NUMBERS = ["NaN", "Infinity", "-Infinity"];

/* What JSON has not, of what people write by hand. */
function advice(text) {
  const bare = text.replace(RegExp(STRING, "g"), '""');
  if (/\/[/*]|#/.test(bare)) return "; JSON has no comments";
  return /,\s*[}\]]/.test(bare) ? "; JSON has no comma before a closing bracket" : "";
}

/* The value of a JSON text. NaN and infinities, which programs write and JSON has not, are let through: whoever reads the field names it. */
function parsed(text) {
  try { return JSON.parse(text); } catch (error) {
    const marked = text.replace(RegExp(`${STRING}|-?Infinity|NaN`, "g"), (token) => (NO_NUMBERS.includes(token) ? `"\\u0000${token}"` : token));
    const unmarked = (_, value) => (typeof value === "string" && value[0] === "\0" && NO_NUMBERS.includes(value.slice(1)) ? Number(value.slice(1)) : value);
    try { return JSON.parse(marked, unmarked); } catch { throw new Error(`not a readable JSON file (${error.message}${advice(text)})`); }
  }
}

/* Read the content of a keyframe file: { start, keyframes }. */
export function read(text, site) {
  const content = parsed(text);
  checkFields(text);
  if (!isObject(content) || content.format !== "plat-keyframes") throw new Error("not a keyframe file, expected an object with 'format': 'plat-keyframes'");
  const { version, quaternion_order: order } = content;
  if (Number.isInteger(version) && version > 2) throw new Error(`version is ${shown(version)}, this plat reads up to 2: update plat`);
  if (version !== 1 && version !== 2) throw new Error(`version is ${shown(version)}, expected 1 or 2`);
  fields(content, ["format", "version", "robot", "quaternion_order", "keyframes"], ["start"], "");
  if (content.robot !== site.robot) throw new Error(`robot is ${shown(content.robot)}, expected '${site.robot}'`);
  if (!["wxyz", "xyzw"].includes(order)) throw new Error(`quaternion_order is ${shown(order)}, expected 'wxyz' or 'xyzw'`);
  if (!Array.isArray(content.keyframes) || !content.keyframes.length) throw new Error("keyframes: expected a list of at least one");
  const one = (entry, label, required, optional) => {
    if (!isObject(entry)) throw new Error(`${label} is ${shown(entry)}, expected an object`);
    if (version === 1 && required.includes("time") && "commands" in entry) throw new Error(`${label}: commands is a field of version 2, and version is 1`);
    fields(entry, required, optional, `${label}: `);
    if (entry.name !== undefined && entry.name !== null && typeof entry.name !== "string") throw new Error(`${label}: name is ${shown(entry.name)}, expected a text`);
    const place = numbers(entry.root_pos, 3, `${label}: root_pos`), given = numbers(entry.root_quat, 4, `${label}: root_quat`);
    checkPlace(place, `${label}: `);
    const quat = order === "xyzw" ? [given[3], ...given.slice(0, 3)] : given, length = Math.hypot(...quat);
    if (Math.abs(length - 1) > UNIT) throw new Error(`${label}: root_quat has length ${length.toPrecision(4)}, expected 1`);
    const time = "time" in entry ? number(entry.time, `${label}: time`) : 0;
    if (Math.abs(time) > LONGEST) throw new Error(`${label}: time is ${general(time)} s, expected at most a day (${LONGEST} s): in milliseconds?`);
    return {
      time, name: entry.name ?? null, commands: "commands" in entry ? commanded(entry.commands, site, label) : null,
      qpos: [...place, ...quat.map((value) => value / length), ...jointAngles(entry.joint_pos, site, label)],
    };
  };
  const optional = version === 1 ? ["name"] : ["name", "commands"];
  const keyframes = content.keyframes.map((entry, index) => one(entry, `keyframe ${index}${typeof entry?.name === "string" ? ` (${shown(entry.name)})` : ""}`, ["time", ...POSE], optional));
  const steps = [0, ...keyframes.map((frame) => nearestStep(frame.time, site))];
  steps.forEach((step, index) => {
    if (index && step <= steps[index - 1]) throw new Error(`keyframe ${index - 1}: time is ${keyframes[index - 1].time} s, expected later than the one before`);
  });
  return { start: "start" in content ? { ...one(content.start, "start", POSE, ["name"]), time: 0 } : standing(site), keyframes };
}

/* The content of a keyframe file. */
export function write(timeline) {
  const { site } = timeline;
  const entry = (frame) => ({
    ...(frame.name ? { name: frame.name } : {}),
    root_pos: frame.qpos.slice(0, 3),
    root_quat: frame.qpos.slice(3, 7),
    joint_pos: Object.fromEntries(site.joints.map((name, joint) => [name, frame.qpos[7 + joint]])),
    ...(mask(frame, site) ? { commands: frame.commands } : {}),
  });
  const frames = timeline.toKeyframes();
  const content = {
    format: "plat-keyframes", version: frames.some((frame) => mask(frame, site)) ? 2 : 1, robot: site.robot, quaternion_order: "wxyz",
    start: entry({ ...timeline.start, commands: null }), keyframes: frames.map((frame) => ({ time: frame.time, ...entry(frame) })),
  };
  return JSON.stringify(content, null, 2) + "\n";
}

const holdName = (frame) => `${frame.name || ""} ${HOLD}`.trim();

/* Whether a keyframe of a file only ends the hold of the one before it: all but its time is the same. */
const endsHold = (before, frame, site) =>
  frame.name === holdName(before) && String(mask(frame, site)) === String(mask(before, site)) && frame.qpos.every((value, index) => value === before.qpos[index]);

/* Timeline of a start and keyframes, one of them selected (0 is the start). Every edit returns a new one. */
export class Timeline {
  constructor(site, start, keyframes = [], holds = [], selected = 0) {
    Object.assign(this, { site, start, keyframes, holds, selected });
  }

  static of(site, { start, keyframes }) {
    const frames = [], holds = [];
    for (const frame of keyframes) {
      const last = frames[frames.length - 1];
      if (last && endsHold(last, frame, site)) holds[holds.length - 1] = round(frame.time - last.time);
      else { frames.push(frame); holds.push(0); }
    }
    return new Timeline(site, start, frames, holds, Math.min(1, frames.length));
  }

  get poses() { return [this.start, ...this.keyframes]; }
  get pose() { return this.poses[this.selected]; }
  get hold() { return this.selected ? this.holds[this.selected - 1] : 0; }
  get duration() { const last = this.keyframes.length - 1; return last < 0 ? 0 : round(this.keyframes[last].time + this.holds[last]); }
  get interval() { return this.selected ? round(this.gaps()[this.selected - 1] * this.site.control_dt) : 0; }
  get labels() { return this.poses.map((pose, number) => (number ? `${number} ${pose.name || ""}`.trim() : "start")); }

  steps(time) { return nearestStep(time, this.site); }
  /* Of keyframes between control steps the end is rounded, as where they are played. */
  holdSteps() { return this.holds.map((hold, index) => this.steps(this.keyframes[index].time + hold) - this.steps(this.keyframes[index].time)); }
  gaps() {
    const holds = this.holdSteps();
    let end = 0;
    return this.keyframes.map((frame, index) => {
      const arrival = this.steps(frame.time), gap = arrival - end;
      end = arrival + holds[index];
      return gap;
    });
  }
  /* The control steps nearest to an interval or hold (s) that are allowed, where it had so many before. */
  allowed(seconds, least = 1, had = 0) { return Math.min(Math.max(this.steps(seconds), least), Math.max(this.steps(LONGEST_INTERVAL), had)); }
  spaced(frames, gaps, holds, selected) {
    let end = 0;
    const timed = frames.map((frame, index) => {
      const time = round((end + gaps[index]) * this.site.control_dt);
      end += gaps[index] + holds[index];
      return { ...frame, time };
    });
    return new Timeline(this.site, this.start, timed, holds.map((hold) => round(hold * this.site.control_dt)), selected);
  }
  must(what) { if (!this.selected) throw new Error(`the start pose cannot be ${what}: select a keyframe`); }

  toKeyframes() {
    return this.keyframes.flatMap((frame, index) => {
      const hold = this.holds[index];
      return hold ? [frame, { ...frame, time: round(frame.time + hold), name: holdName(frame) }] : [frame];
    });
  }

  /* The keyframes to play, with long intervals split: each with the number of the one that it leads to or holds. */
  sequence(maxSteps) {
    if (!this.keyframes.length) throw new Error("there are no keyframes yet: press A, or add a template");
    const result = [];
    let before = this.start;
    for (const frame of this.toKeyframes()) {
      const first = this.steps(before.time), steps = this.steps(frame.time) - first, parts = Math.ceil(steps / maxSteps);
      for (let part = 1; part < parts; part++) {
        const time = round((first + Math.floor((part * steps) / parts)) * this.site.control_dt);
        result.push({ ...interpolate(before, frame, time), name: frame.name && `${frame.name} ${part}/${parts}`, commands: frame.commands });
      }
      result.push(frame);
      before = asArrived(before, frame, this.site);
    }
    const ends = this.keyframes.map((frame, index) => frame.time + this.holds[index] + 1e-6);
    return result.map((frame) => ({ ...frame, number: ends.findIndex((end) => frame.time <= end) + 1 }));
  }

  sample(time) {
    let before = this.start, end = 0;
    for (let index = 0; index < this.keyframes.length; index++) {
      const frame = this.keyframes[index];
      if (time < frame.time) return interpolate({ ...before, time: end }, frame, Math.max(time, end));
      before = frame;
      end = frame.time + this.holds[index];
      if (time <= end) break;
    }
    return { ...before, time };
  }

  at(time) { return this.poses.findIndex((pose) => this.steps(pose.time) === this.steps(time)); }
  shows(time) { return time >= this.pose.time - 1e-6 && time <= this.pose.time + this.hold + 1e-6; }
  select(number) { return new Timeline(this.site, this.start, this.keyframes, this.holds, Math.min(Math.max(number, 0), this.keyframes.length)); }
  withPose(pose) {
    const poses = this.poses;
    poses[this.selected] = pose;
    return new Timeline(this.site, poses[0], poses.slice(1), this.holds, this.selected);
  }
  posed(qpos) { return this.withPose({ ...this.pose, qpos: [...qpos] }); }
  renamed(name) { this.must("renamed"); return this.withPose({ ...this.pose, name: name.trim().replace(/(\s*\(hold\))+$/, "") || null }); }
  commanding(commands) { this.must("commanded in part"); return this.withPose({ ...this.pose, commands }); }

  inserted(pose, interval = NEW_INTERVAL, hold = 0) {
    const frames = [...this.keyframes], gaps = this.gaps(), holds = this.holdSteps();
    frames.splice(this.selected, 0, pose);
    gaps.splice(this.selected, 0, this.allowed(interval));
    holds.splice(this.selected, 0, this.allowed(hold, 0));
    return this.spaced(frames, gaps, holds, this.selected + 1);
  }
  insertedAt(time) {
    const step = this.steps(time), arrivals = this.keyframes.map((frame) => this.steps(frame.time)), kept = this.holdSteps();
    const ends = arrivals.map((arrival, index) => arrival + kept[index]);
    if (step <= 0) return this.select(0);
    const within = arrivals.findIndex((arrival, index) => arrival <= step && step <= ends[index]);
    if (within >= 0) return this.select(within + 1);
    const here = ends.filter((end) => end < step).length, gap = step - (here ? ends[here - 1] : 0);
    const frames = [...this.keyframes], gaps = this.gaps();
    const { commands = null } = frames[Math.min(here, frames.length - 1)] ?? this.start; // of the one that it leads to
    frames.splice(here, 0, { ...this.sample(step * this.site.control_dt), name: null, commands });
    gaps.splice(here, 0, gap);
    kept.splice(here, 0, 0);
    if (here + 1 < gaps.length) gaps[here + 1] -= gap;
    return this.spaced(frames, gaps, kept, here + 1);
  }
  /* For each keyframe, the pose that the robot leaves for it, with its time, and the keyframe. */
  get ways() {
    let before = this.start, end = 0;
    return this.keyframes.map((frame, index) => {
      const way = [{ ...before, time: end }, frame];
      before = asArrived(before, frame, this.site);
      end = frame.time + this.holds[index];
      return way;
    });
  }
  /* That of them to the selected keyframe. */
  get way() { this.must("gone to"); return this.ways[this.selected - 1]; }
  /* With a pose midway to the selected keyframe, which stays selected; no keyframe moves. */
  parted(qpos) {
    const [before, after] = this.way, first = this.steps(before.time), last = this.steps(after.time);
    if (last - first < 2) throw new Error(`keyframe at ${general(after.time)} s${after.name ? ` ('${after.name}')` : ""}: a control step after the one before, expected 2 to put one between`);
    const parted = this.insertedAt(Math.floor((first + last) / 2) * this.site.control_dt);
    return parted.withPose({ ...parted.pose, qpos, commands: after.commands }).select(this.selected + 1);
  }
  removed() {
    this.must("removed");
    const drop = (list) => list.filter((_, index) => index !== this.selected - 1);
    return this.spaced(drop(this.keyframes), drop(this.gaps()), drop(this.holdSteps()), Math.min(this.selected, this.keyframes.length - 1));
  }
  stretched(interval) {
    this.must("moved in time");
    const gaps = this.gaps();
    gaps[this.selected - 1] = this.allowed(interval, 1, gaps[this.selected - 1]);
    return this.spaced(this.keyframes, gaps, this.holdSteps(), this.selected);
  }
  held(seconds) {
    this.must("held");
    const holds = this.holdSteps();
    holds[this.selected - 1] = this.allowed(seconds, 0, holds[this.selected - 1]);
    return this.spaced(this.keyframes, this.gaps(), holds, this.selected);
  }
  retimed(number, time) {
    const gaps = this.gaps(), holds = this.holdSteps(), sum = (list) => list.slice(0, number - 1).reduce((a, b) => a + b, 0);
    let asked = this.allowed((this.steps(time) - sum(gaps) - sum(holds)) * this.site.control_dt, 1, gaps[number - 1]);
    if (number < gaps.length) {
      const both = gaps[number - 1] + gaps[number];
      asked = Math.min(asked, both - 1);
      gaps[number] = both - asked;
    }
    gaps[number - 1] = asked;
    return this.spaced(this.keyframes, gaps, holds, this.selected);
  }
}
