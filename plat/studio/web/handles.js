/* Handles in the scene that viser draws: what of a ball is hidden behind something is drawn faintly. For the mouse arrows come
   first, then the ball whose center is nearest, then bodies. The library has no setting for that, so its objects are
   changed once they are there. */
(() => {
  "use strict";
  const BALLS = "/world/handles/", BODIES = "/world/pose/", OFTEN = 300; // ms
  const BALL = 500, BODY = 1000; // distances (m) beyond those of arrows, by which the library sorts
  const GREATER_DEPTH = 6, FAINT = 0.45; // number of a depth function; opacity
  const known = new WeakSet();

  function mend() {
    const nodes = window.__viserMutable ? window.__viserMutable.nodeRefFromName : {};
    for (const name in nodes) {
      const shape = nodes[name]?.children.find((child) => child.isMesh);
      const ball = name.startsWith(BALLS);
      if (!shape || !(ball || name.startsWith(BODIES))) continue;
      // their outlines would be found, too, even where they are not to be seen
      shape.traverse((part) => { if (part !== shape) part.raycast = () => {}; });
      if (known.has(shape)) continue;
      known.add(shape);
      if (!ball) sort(shape, (one) => BODY + one.distance);
      else {
        shineThrough(shape);
        sort(shape, (one, ray) => BALL + ray.distanceToPoint(shape.getWorldPosition(one.point.clone())) / one.distance);
      }
    }
  }

  function shineThrough(ball) {
    const hidden = new ball.constructor(ball.geometry, ball.material.clone());
    Object.assign(hidden.material, { depthFunc: GREATER_DEPTH, depthWrite: false, transparent: true, opacity: FAINT });
    hidden.renderOrder = 1; // after all that may hide it
    hidden.onBeforeRender = () => hidden.material.color.copy(ball.material.color);
    ball.add(hidden);
  }

  function sort(shape, distance) { // what the mouse finds of it is as far away as `distance` says
    const { raycast } = shape;
    shape.raycast = (caster, found) => {
      const own = [];
      raycast.call(shape, caster, own);
      for (const one of own) found.push({ ...one, distance: distance(one, caster.ray) });
    };
  }

  setInterval(mend, OFTEN);
})();
