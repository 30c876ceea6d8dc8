/* Robot in MuJoCo: bodies of a pose, physics, inverse kinematics, and how it would stand. */
import { conjugate, exponential, heading, logarithm, multiply, normalized, rotated } from "./rotations.mjs";

const DRAGGED = [3, 0.3], POINT = [3, 0], HELD = [15, 5], HELD_FOOT = [30, 10], REST = 0.03, DAMPING = 1e-4, ERROR_DAMPING = 0.1;
const ITERATIONS = 30, SETTLED = 1e-4, ON_FLOOR = 0.015;
const SUNK = 0.3, BEYOND = 1e3; // so deep in the floor a robot is thrown up by meters; distances are capped there (m)

/* The point on the floor below the root, with the root's heading. */
const spot = (qpos) => ({ pos: [qpos[0], qpos[1], 0], quat: heading(qpos.slice(3, 7)) });

/* The pose as it is, at another place and heading. */
function carried(qpos, target) {
  const here = spot(qpos), turn = multiply(heading(target.quat), conjugate(here.quat));
  return [...qpos.slice(0, 3).map((value, axis) => value + target.pos[axis] - here.pos[axis]), ...multiply(turn, qpos.slice(3, 7)), ...qpos.slice(7)];
}

export class Robot {
  constructor(mujoco, site) {
    Object.assign(this, { mujoco, site });
    this.model = mujoco.MjModel.from_xml_string(site.xml);
    this.scratch = new mujoco.MjData(this.model);
    this.nv = this.model.nv;
    const names = {};
    for (let body = 0; body < this.model.nbody; body++) names[this.model.body(body).name] = body;
    this.bodies = names;
    this.bodyNames = Object.keys(names);
    const id = (name) => { if (!(name in names)) throw new Error(`body ${name} is not in the model`); return names[name]; };
    this.keypoints = site.keypoints.map(id);
    this.anchor = site.keypoints.indexOf(site.anchor);
    this.ends = site.end_effectors.map((name) => site.keypoints.indexOf(name));
    this.feet = site.feet.map(id);
    this.floor = this.model.geom("floor").id;
    const types = this.model.geom_contype, affinities = this.model.geom_conaffinity;  // as touches_floor in Python
    const meetsFloor = (geom) => types[geom] & affinities[this.floor] | types[this.floor] & affinities[geom];
    this.solid = [...types.keys()].filter((geom) => meetsFloor(geom) && this.model.geom_bodyid[geom] > 0);
    this.jacp = new mujoco.DoubleBuffer(3 * this.nv);
    this.jacr = new mujoco.DoubleBuffer(3 * this.nv);
    this.bad = ["QPOS", "QVEL", "QACC", "CTRL"].map((what) => mujoco.mjtWarning[`mjWARN_BAD${what}`].value);
    this.substeps = Math.round(site.control_dt / this.model.opt.timestep);
  }

  place(qpos) {
    this.scratch.qpos.set(qpos);
    this.mujoco.mj_kinematics(this.model, this.scratch);
  }

  /* Positions and orientations of all bodies in a pose. */
  placed(qpos) {
    this.place(qpos);
    return { pos: Float64Array.from(this.scratch.xpos), quat: Float64Array.from(this.scratch.xquat) };
  }

  /* Positions and orientations of the keypoints. */
  points(qpos) {
    this.place(qpos);
    const { xpos, xquat } = this.scratch;
    return this.keypoints.map((body) => ({ pos: [...xpos.subarray(3 * body, 3 * body + 3)], quat: [...xquat.subarray(4 * body, 4 * body + 4)] }));
  }

  /* The frame of each handle in a pose. */
  frames(qpos) {
    this.place(qpos);
    return Object.fromEntries(Object.entries(this.site.handles).map(([name, handle]) => [name, handle.body === null ? spot(qpos) : this.frame(handle)]));
  }

  frame({ body, pos }) {
    const number = this.bodies[body], { xpos, xquat } = this.scratch;
    const quat = [...xquat.subarray(4 * number, 4 * number + 4)], shift = rotated(quat, pos);
    return { pos: [0, 1, 2].map((axis) => xpos[3 * number + axis] + shift[axis]), quat };
  }

  /* The place of a joint, and an orientation whose z axis is the joint's. */
  jointFrame(joint, qpos) {
    this.place(qpos);
    const from = 3 * (joint + 1), [x, y, z] = this.scratch.xaxis.subarray(from, from + 3);
    const quat = z > -1 + 1e-9 ? normalized([1 + z, -y, x, 0]) : [0, 1, 0, 0];
    return { pos: [...this.scratch.xanchor.subarray(from, from + 3)], quat };
  }

  // physics

  begin(qpos) {
    const { sunk } = this.contacts(qpos);
    if (sunk > SUNK) throw new Error(`start: the robot is ${(100 * sunk).toFixed(0)} cm inside the floor, expected a start on it`);
    const data = new this.mujoco.MjData(this.model);
    data.qpos.set(qpos);
    this.mujoco.mj_forward(this.model, data);
    return data;
  }

  state(data) {
    const qpos = [...data.qpos], qvel = [...data.qvel];
    return { qpos, joint_vel: qvel.slice(6), root_lin_vel_b: rotated(conjugate(qpos.slice(3, 7)), qvel.slice(0, 3)), root_ang_vel_b: qvel.slice(3, 6) };
  }

  /* Hold joint targets for a control step; returns whether the simulation did not diverge. */
  step(data, targets) {
    data.ctrl.set(targets);
    for (let count = 0; count < this.substeps; count++) this.mujoco.mj_step(this.model, data);
    return !this.bad.some((kind) => { const one = data.warning.get(kind), { number } = one; one.delete(); return number > 0; });
  }

  // posing

  /* The pose with a handle at a target, or as near as joint limits and held handles allow; weighted damped least squares. */
  dragged(qpos, handle, target, held, rest, limbOnly) {
    if (this.site.handles[handle].body === null) return carried(rest, target);
    const point = /(elbow|knee)$/.test(handle);
    const tasks = [{ handle, target, cost: point ? POINT : DRAGGED }];
    let free = null;
    if (limbOnly) {
      const limb = this.site.limbs[handle];
      free = new Set(limb.length ? limb.map((joint) => 6 + joint) : [0, 1, 2, 3, 4, 5]);
    } else for (const [other, frame] of Object.entries(held)) if (other !== handle) tasks.push({ handle: other, target: frame, cost: other.endsWith("foot") ? HELD_FOOT : HELD });
    return this.solved(qpos, tasks, rest, free);
  }

  /* The pose with both feet flat on the floor below where they are. */
  flat(qpos) {
    const frames = this.frames(qpos), tasks = [{ handle: "pelvis", target: frames.pelvis, cost: HELD }];
    for (const handle of ["left foot", "right foot"]) {
      const { pos: [x, y], quat } = frames[handle];
      tasks.push({ handle, target: { pos: [x, y, this.site.ankle_height], quat: heading(quat) }, cost: HELD_FOOT });
    }
    return this.solved(qpos, tasks, qpos, null);
  }

  /* The default pose at the place and heading of a pose. */
  standing(qpos) { return carried(this.site.default_qpos, spot(qpos)); }

  /* The pose with a template's step made, see plat.studio.templates. */
  changed(qpos, { moved, bent }) {
    let pose = qpos;
    for (const [handle, by] of moved) {
      const frames = this.frames(pose), shift = rotated(spot(pose).quat, by), { pos, quat } = frames[handle];
      const held = Object.fromEntries(["left foot", "right foot", "pelvis"].map((name) => [name, frames[name]]));
      pose = this.dragged(pose, handle, { pos: pos.map((value, axis) => value + shift[axis]), quat }, held, pose, false);
    }
    pose = [...pose];
    for (const [joint, angle] of Object.entries(bent)) pose[7 + this.site.joints.indexOf(joint)] = angle;
    return pose;
  }

  solved(qpos, tasks, rest, free) {
    const pose = [...qpos];
    this.limit(pose);
    for (let count = 0; count < ITERATIONS; count++) if (this.improve(pose, tasks, rest, free) < SETTLED) break;
    return pose;
  }

  limit(pose) {
    this.site.joint_range.forEach(([low, high], joint) => { pose[7 + joint] = Math.min(Math.max(pose[7 + joint], low), high); });
  }

  improve(pose, tasks, rest, free) {
    const n = this.nv, normal = new Float64Array(n * n), right = new Float64Array(n);
    this.place(pose);
    this.mujoco.mj_comPos(this.model, this.scratch);
    for (const { handle, target, cost } of tasks) {
      const frame = this.frame(this.site.handles[handle]), { mujoco, jacp, jacr } = this;
      mujoco.mj_jac(this.model, this.scratch, jacp, jacr, frame.pos, this.bodies[this.site.handles[handle].body]);
      const turn = logarithm(multiply(target.quat, conjugate(frame.quat)));
      const rows = [[jacp.GetView(), target.pos.map((value, axis) => value - frame.pos[axis]), cost[0]], [jacr.GetView(), turn, cost[1]]];
      let error = 0;
      for (const [jacobian, wanted, weight] of rows) for (let axis = 0; axis < 3; axis++) {
        if (!weight) continue;
        const square = weight * weight;
        error += square * wanted[axis] ** 2;
        for (let i = 0; i < n; i++) {
          const left = square * jacobian[axis * n + i];
          if (!left) continue;
          right[i] += left * wanted[axis];
          for (let j = 0; j < n; j++) normal[i * n + j] += left * jacobian[axis * n + j];
        }
      }
      for (let i = 0; i < n; i++) normal[i * n + i] += ERROR_DAMPING * error;
    }
    for (let i = 0; i < n; i++) {
      normal[i * n + i] += DAMPING + (i >= 6 ? REST * REST : 1e-6);
      if (i >= 6) right[i] += REST * REST * (rest[1 + i] - pose[1 + i]);
    }
    // joints at their limits that would go beyond are taken out, and the rest is solved again
    const out = new Set();
    if (free) for (let i = 0; i < n; i++) if (!free.has(i)) out.add(i);
    let step;
    for (let count = 0; count < 8; count++) {
      step = solve(normal, right, n, out);
      let found = false;
      this.site.joint_range.forEach(([low, high], joint) => {
        const now = pose[7 + joint], dof = 6 + joint;
        if (!out.has(dof) && ((now >= high - 1e-9 && step[dof] > 1e-9) || (now <= low + 1e-9 && step[dof] < -1e-9))) { out.add(dof); found = true; }
      });
      if (!found) break;
    }
    for (let axis = 0; axis < 3; axis++) pose[axis] += step[axis];
    const quat = normalized(multiply(pose.slice(3, 7), exponential([...step.slice(3, 6)])));
    for (let part = 0; part < 4; part++) pose[3 + part] = quat[part];
    for (let dof = 6; dof < n; dof++) pose[1 + dof] += step[dof];
    this.limit(pose);
    return Math.max(...step.map(Math.abs));
  }

  mirrored(qpos) {
    const { partner, sign } = this.site.mirror, head = heading(qpos.slice(3, 7));
    const lean = multiply(conjugate(head), qpos.slice(3, 7)), image = [lean[0], -lean[1], lean[2], -lean[3]];
    return [...qpos.slice(0, 3), ...multiply(head, image), ...partner.map((other, joint) => sign[joint] * qpos[7 + other])];
  }

  /* What a mirrored keyframe commands: joints and bodies of the other side. */
  mirroredCommands(commands) {
    const { joints, keypoints, mirror } = this.site, across = (names, all, partner) => names.map((name) => all[partner[all.indexOf(name)]]);
    return commands && {
      ...commands,
      ...(commands.joints ? { joints: across(commands.joints, joints, mirror.partner) } : {}),
      ...(commands.bodies ? { bodies: across(commands.bodies, keypoints, mirror.keypoints) } : {}),
    };
  }

  symmetric(qpos, side) {
    const image = this.mirrored(qpos), other = side === "left" ? "right_" : "left_";
    return qpos.map((value, index) => (index >= 7 && this.site.joints[index - 7].startsWith(other) ? image[index] : value));
  }

  /* The pose with its lowest point on the floor. */
  dropped(qpos) {
    this.place(qpos);
    const lowest = Math.min(...this.solid.map((geom) => this.mujoco.mj_geomDistance(this.model, this.scratch, this.floor, geom, BEYOND, null)));
    return qpos.map((value, index) => (index === 2 ? value - lowest : value));
  }

  solePoints(qpos) {
    this.place(qpos);
    const { xpos, xquat } = this.scratch;
    return this.feet.map((body, foot) => this.site.soles[foot].map(({ pos, radius }) => {
      const turned = rotated([...xquat.subarray(4 * body, 4 * body + 4)], pos);
      return [xpos[3 * body] + turned[0], xpos[3 * body + 1] + turned[1], xpos[3 * body + 2] + turned[2] - radius];
    }));
  }

  center(qpos) {
    this.place(qpos);
    this.mujoco.mj_comPos(this.model, this.scratch);
    return [...this.scratch.subtree_com.subarray(3, 6)];
  }

  /* Links that are inside each other, and how deep the robot is in the floor (m). */
  contacts(qpos) {
    const inside = new Set();
    let sunk = 0;
    for (const { depth, pair } of this.touching(qpos)) {
      if (!pair.every(Boolean)) sunk = Math.max(sunk, depth);
      else if (depth > this.site.limits.self_penetration) pair.forEach((body) => inside.add(body));
    }
    return { inside, sunk };
  }

  /* Pairs of bodies that touch in a pose, the world's among them, and how deep they are in each other (m). */
  touching(qpos) {
    this.place(qpos);
    this.mujoco.mj_collision(this.model, this.scratch);
    const found = this.scratch.contact, touching = [];
    for (let number = 0; number < found.size(); number++) {
      const contact = found.get(number);
      touching.push({ depth: -contact.dist, pair: [contact.geom1, contact.geom2].map((geom) => this.model.geom_bodyid[geom]) });
      contact.delete();
    }
    found.delete();
    return touching;
  }

  /* How deep two links are in each other at most, and their names, in the joint angles of a pose; of some links alone if these are given. */
  deepest(qpos, among) {
    let depth = 0, names = [];
    for (const { depth: deep, pair } of this.touching([...this.site.default_qpos.slice(0, 7), ...qpos.slice(7)])) {
      if (deep > depth && pair.every((body) => body && (!among || among.has(body)))) [depth, names] = [deep, pair.map((body) => this.bodyNames[body])];
    }
    return { depth, names };
  }

  /* How the hands move along x, y and z by each joint but those of the legs, in the root's frame. */
  handSlopes(qpos) {
    const { limbs, handles, joints } = this.site, legs = new Set([...limbs["left foot"], ...limbs["right foot"]]);
    this.place([0, 0, 0, 1, 0, 0, 0, ...qpos.slice(7)]);
    this.mujoco.mj_comPos(this.model, this.scratch);
    return ["left hand", "right hand"].map((hand) => {
      const body = this.bodies[handles[hand].body], from = 3 * body;
      this.mujoco.mj_jac(this.model, this.scratch, this.jacp, this.jacr, [...this.scratch.xpos.subarray(from, from + 3)], body);
      const found = this.jacp.GetView();
      return [0, 1, 2].map((axis) => joints.map((_, joint) => (legs.has(joint) ? 0 : found[axis * this.nv + 6 + joint])));
    });
  }

  /* The links that are where they were drawn, as the root is: between it and flagged keypoints, and those that flagged joints alone lead to. */
  placedLinks(joints, keypoints, asDrawn) {
    const { jnt_bodyid: moved, body_parentid: parent, body_jntadr: joint, jnt_pos: place } = this.model, free = new Set([...moved.slice(1)].filter((_, joint) => !joints[joint])), placed = new Set([1]);
    for (let body = 2; body < parent.length; body++) if (placed.has(parent[body]) && !free.has(body)) placed.add(body);
    const turns = (body) => free.has(body) && [0, 1, 2].every((axis) => !place[3 * joint[body] + axis]);
    for (let body of this.keypoints.filter((_, number) => keypoints[number])) {
      if (!asDrawn && turns(body)) body = parent[body];
      for (; body; body = parent[body]) placed.add(body);
    }
    return placed;
  }

  /* Center of mass, support polygon, how far inside it (m; null in the air), and words. */
  stance(qpos) {
    const points = this.solePoints(qpos), center = this.center(qpos);
    const down = points.map((foot) => foot.filter((point) => point[2] < ON_FLOOR));
    const support = hull(down.flat().map((point) => point.slice(0, 2)));
    if (!support.length) return { center, support, margin: null, words: "no foot on the floor" };
    const gap = margin(center, support), standing = down[0].length && down[1].length ? "both feet" : down[0].length ? "left foot" : "right foot";
    const balance = gap >= 0 ? `balanced with ${(100 * gap).toFixed(0)} cm to spare` : `${(-100 * gap).toFixed(0)} cm out of balance`;
    return { center, support, margin: gap, words: `on ${standing}, ${balance}` };
  }
}

export function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  if (sorted.length < 3) return sorted;
  const turn = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  const chain = (list) => {
    const corners = [];
    for (const point of list) {
      while (corners.length > 1 && turn(corners[corners.length - 2], corners[corners.length - 1], point) <= 0) corners.pop();
      corners.push(point);
    }
    return corners.slice(0, -1);
  };
  return [...chain(sorted), ...chain(sorted.reverse())];
}

export function margin(point, support) {
  let least = Infinity;
  for (let count = 0; count < 720; count++) {
    const c = Math.cos((count * Math.PI) / 360), s = Math.sin((count * Math.PI) / 360);
    least = Math.min(least, Math.max(...support.map((corner) => (corner[0] - point[0]) * c + (corner[1] - point[1]) * s)));
  }
  return least;
}

/* Solve the symmetric system by Cholesky's decomposition, without the unknowns in `out`. */
function solve(normal, right, n, out) {
  const keep = [];
  for (let i = 0; i < n; i++) if (!out.has(i)) keep.push(i);
  const m = keep.length, lower = new Float64Array(m * m), y = new Float64Array(m), step = new Float64Array(n);
  for (let i = 0; i < m; i++) for (let j = 0; j <= i; j++) {
    let sum = normal[keep[i] * n + keep[j]];
    for (let k = 0; k < j; k++) sum -= lower[i * m + k] * lower[j * m + k];
    lower[i * m + j] = i === j ? Math.sqrt(Math.max(sum, 1e-12)) : sum / lower[j * m + j];
  }
  for (let i = 0; i < m; i++) {
    let sum = right[keep[i]];
    for (let k = 0; k < i; k++) sum -= lower[i * m + k] * y[k];
    y[i] = sum / lower[i * m + i];
  }
  for (let i = m - 1; i >= 0; i--) {
    let sum = y[i];
    for (let k = i + 1; k < m; k++) sum -= lower[k * m + i] * step[keep[k]];
    step[keep[i]] = sum / lower[i * m + i];
  }
  return step;
}
