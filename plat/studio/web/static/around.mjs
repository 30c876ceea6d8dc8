/* Poses to pass by where the straight way between two leads through the robot; as plat.tasks.ways_around, by which they are tested. */
import { normalized } from "./rotations.mjs";

function part(a, b, share) {
  const pose = a.map((value, at) => value + share * (b[at] - value)), same = a.slice(3, 7).reduce((sum, value, at) => sum + value * b[3 + at], 0) >= 0;
  const turn = [3, 4, 5, 6].map((at) => (1 - share) * a[at] + share * (same ? b[at] : -b[at]));
  pose.splice(3, 4, ...normalized(turn));
  return pose;
}

function line(a, b, parts) {
  return Array.from({ length: parts - 1 }, (_, number) => part(a, b, (number + 1) / parts));
}

/* A pose midway from which both halves are clear; null where the straight line is, or none is found. */
export function between(robot, before, after) {
  const { way_parts: parts, around } = robot.site, inside = (poses) => poses.some((pose) => robot.deepest(pose).depth >= around.inside);
  if (inside([before, after]) || !inside(line(before, after, parts))) return null;
  const middle = part(before, after, 0.5), slopes = robot.handSlopes(middle);
  const directions = around.moves.map((move) => {
    const slope = slopes[0][0].map((_, joint) => move.reduce((sum, by, hand) => sum + by.reduce((way, value, axis) => way + value * slopes[hand][axis][joint], 0), 0));
    const most = Math.max(...slope.map(Math.abs), 1e-6);
    return slope.map((value) => value / most);
  });
  for (const angle of around.further) for (const direction of directions) {
    const passed = middle.map((value, at) => (at < 7 ? value : value + angle * direction[at - 7]));
    robot.limit(passed);
    if (!inside([passed, ...line(before, passed, parts), ...line(passed, after, parts)])) return passed;
  }
  return null;
}
