/* Rotations as quaternions [w, x, y, z]. */
export const multiply = (a, b) => [
  a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
  a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
  a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
  a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
];

export const conjugate = (q) => [q[0], -q[1], -q[2], -q[3]];

export const normalized = (q) => { const length = Math.hypot(...q); return q.map((value) => value / length); };

/* Rows of the rotation matrix. */
export function matrix(q) {
  const [w, x, y, z] = normalized(q);
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

/* The vector times the matrix: from the world into the frame. */
export const into = (m, v) => [0, 1, 2].map((c) => v[0] * m[0][c] + v[1] * m[1][c] + v[2] * m[2][c]);

export const rotated = (q, v) => matrix(q).map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

export const angle = (a, b) => {
  const [w, ...v] = multiply(conjugate(a), b);
  return 2 * Math.atan2(Math.hypot(...v), Math.abs(w));
};

/* Rotation vector of a quaternion (rad), by the shorter way. */
export function logarithm(q) {
  const sign = q[0] < 0 ? -1 : 1, length = Math.hypot(q[1], q[2], q[3]);
  const factor = length < 1e-12 ? 2 : (2 * Math.atan2(length, sign * q[0])) / length;
  return [sign * q[1] * factor, sign * q[2] * factor, sign * q[3] * factor];
}

export function exponential(v) {
  const turn = Math.hypot(...v), factor = turn < 1e-12 ? 0.5 : Math.sin(turn / 2) / turn;
  return [Math.cos(turn / 2), v[0] * factor, v[1] * factor, v[2] * factor];
}

/* Spherical interpolation along the shorter arc. */
export function slerp(a, b, weight) {
  const turn = logarithm(multiply(conjugate(a), b));
  return normalized(multiply(a, exponential(turn.map((value) => weight * value))));
}

/* Angles (rad) with q = Rz(heading) Ry(pitch) Rx(roll), and back. */
export const headingPitchRoll = ([w, x, y, z]) => [
  Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), Math.asin(Math.min(Math.max(2 * (w * y - x * z), -1), 1)), Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
];
export const fromHeadingPitchRoll = ([heading, pitch, roll]) => multiply(exponential([0, 0, heading]), multiply(exponential([0, pitch, 0]), exponential([roll, 0, 0])));

/* The rotation about the vertical alone. */
export const heading = (q) => exponential([0, 0, headingPitchRoll(q)[0]]);
