/* What the robot cannot do, in words. The same rules as plat.control.Feasibility, by which they are tested. */
import { beyond } from "./chase.mjs";
import { mask } from "./keyframes.mjs";
import { margin } from "./robot.mjs";
import { angle } from "./rotations.mjs";

export const WAY = "on the straight way there";
const cm = (meters) => (100 * meters).toFixed(0);
const tenths = (value, limit) => beyond(value, limit, 1).replace(/\.0$/, "");
const apart = (a, b) => Math.hypot(...a.map((value, axis) => value - b[axis]));

/* What is doubtful about a keyframe that is `seconds` after another one, and the fastest of the joints that it commands. */
export function verdict(robot, before, after, seconds, held) {
  const { limits, joints, keypoints } = robot.site, parts = mask(after, robot.site);
  const flags = parts ?? Array(joints.length + keypoints.length + 3).fill(1);
  const speeds = joints.map((_, joint) => (2 * flags[joint] * Math.abs(after.qpos[7 + joint] - before.qpos[7 + joint])) / seconds);
  const order = joints.map((_, joint) => joint).sort((a, b) => speeds[b] - speeds[a]);
  const worst = speeds.indexOf(Math.max(...speeds)), words = [];
  for (const joint of order) if (speeds[joint] > limits.joint_speed) words.push(`${joints[joint]} would need ${tenths(speeds[joint], limits.joint_speed)} rad/s, expected at most ${limits.joint_speed}`);
  words.push(...way(before.qpos, after.qpos, seconds, flags.slice(-3), limits));
  words.push(...links(robot, before.qpos, after.qpos, parts));
  words.push(...(parts ? bodies(robot, before, after, seconds, flags) : pose(robot, after.qpos, held)));
  return { words, joint: speeds[worst] ? joints[worst] : "", speed: speeds[worst], share: speeds[worst] / limits.joint_speed };
}

function way(before, after, seconds, [horizontal, height, orientation], limits) {
  const words = [], distance = horizontal * apart(before.slice(0, 2), after.slice(0, 2)), speed = (2 * distance) / seconds, push = (4 * distance) / seconds ** 2;
  const turn = (2 * orientation * angle(before.slice(3, 7), after.slice(3, 7))) / seconds, takes = `${distance.toFixed(1)} m in ${seconds.toFixed(2)} s takes`;
  if (speed > limits.root_speed) words.push(`${takes} ${speed.toFixed(1)} m/s`);
  if (push > limits.root_acceleration) words.push(`${takes} ${push.toFixed(0)} m/s^2, more than feet can push`);
  const rise = height * (after[2] - before[2]), vertical = (2 * Math.abs(rise)) / seconds;
  if (vertical > limits.vertical_speed) words.push(`${Math.abs(rise).toFixed(1)} m ${rise > 0 ? "up" : "down"} in ${seconds.toFixed(2)} s takes ${vertical.toFixed(1)} m/s`);
  if (turn > limits.turn_speed) words.push(`the turn would need ${tenths(turn, limits.turn_speed)} rad/s, expected at most ${limits.turn_speed}`);
  return words;
}

/* Links in each other in a keyframe, or else on the way there on which all joints move evenly. */
function links(robot, before, after, parts) {
  const { limits, joints, way_parts: count } = robot.site;
  const placed = (asDrawn) => parts && robot.placedLinks(parts.slice(0, joints.length), parts.slice(joints.length, -3), asDrawn), among = placed(true);
  const pair = ({ names, depth }) => [names.join(" and "), `${cm(depth)} cm`];
  const there = robot.deepest(after, placed(false));
  if (there.depth > limits.self_penetration) { const [both, deep] = pair(there); return [`${both} are ${deep} inside each other`]; }
  if ([before, after].some((qpos) => robot.deepest(qpos, among).depth > limits.self_penetration)) return [];
  let worst = there;
  for (let part = 1; part < count; part++) {
    const found = robot.deepest(before.map((value, at) => value + (part / count) * (after[at] - value)), among);
    if (found.depth > worst.depth) worst = found;
  }
  if (worst.depth <= limits.way_penetration) return [];
  const [both, deep] = pair(worst);
  return [`${both} would get ${deep} into each other ${WAY}`];
}

/* Of a partial keyframe: the bodies and the height that it commands. */
function bodies(robot, before, after, seconds, flags) {
  const { limits, joints, keypoints } = robot.site, from = robot.points(before.qpos), to = robot.points(after.qpos);
  const under = (name, height) => (-height > limits.floor_penetration ? [`${name} is ${cm(-height)} cm inside the floor`] : []);
  const words = keypoints.flatMap((name, body) => {
    if (!flags[joints.length + body]) return [];
    const speed = (2 * apart(to[body].pos, from[body].pos)) / seconds;
    return [
      ...(speed > limits.body_speed ? [`${name} would need ${tenths(speed, limits.body_speed)} m/s, expected at most ${limits.body_speed}`] : []),
      ...under(name, to[body].pos[2]),
    ];
  });
  const above = after.qpos[2] - robot.site.default_qpos[2];
  const high = above > limits.clearance ? [`root is ${cm(above)} cm above where it is in standing, higher than a jump`] : [];
  return [...words, ...(flags[flags.length - 2] ? [...under("root", after.qpos[2]), ...high] : [])];
}

function pose(robot, qpos, held) {
  const { limits } = robot.site, { sunk } = robot.contacts(qpos), words = [];
  if (sunk > limits.floor_penetration) words.push(`the robot is ${cm(sunk)} cm inside the floor`);
  const points = robot.solePoints(qpos).flat(), height = Math.min(...points.map((point) => point[2]));
  if (!held) {
    const lowest = Math.min(height, ...robot.points(qpos).map(({ pos }) => pos[2]));
    return lowest > limits.clearance ? [...words, `the robot is ${cm(lowest)} cm above the floor, higher than a jump`] : words;
  }
  if (height > limits.floating) return [...words, `the feet are ${cm(height)} cm above the floor`];
  const gap = margin(robot.center(qpos), points.filter((point) => point[2] < height + limits.floating));
  return gap < limits.support_margin ? [...words, `the center of mass is ${cm(-gap)} cm outside the feet: it would tip over`] : words;
}
