/* What is drawn: robots, poses, how they stand, and the handles to drag them by. */
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

const VISUAL = 2, SPHERE = 2, CAPSULE = 3, ELLIPSOID = 4, CYLINDER = 5, BOX = 6;
const SAME = 0.003;
const REST = 600; // ms after which nothing moves any more
const BRIGHT = { sky: 0xc6d1dc, tile: "#b4bdc6", line: "#929ca6", light: 2.2 }, DARK = { sky: 0x1b2126, tile: "#3a434c", line: "#525d68", light: 1.9 };
const ORANGE = 0xf08c00, BLUE = 0x1c7ed6, PALE = 0xc8cdd2, GREEN = 0x12a15e, RED = 0xd6363b;

function shape(type, [x, y, z]) {
  if (type === SPHERE) return new THREE.SphereGeometry(x, 16, 10);
  if (type === CAPSULE) return new THREE.CapsuleGeometry(x, 2 * y, 6, 16).rotateX(Math.PI / 2);
  if (type === ELLIPSOID) return new THREE.SphereGeometry(1, 18, 12).scale(x, y, z);
  if (type === CYLINDER) return new THREE.CylinderGeometry(x, x, 2 * y, 20).rotateX(Math.PI / 2);
  if (type === BOX) return new THREE.BoxGeometry(2 * x, 2 * y, 2 * z);
  return null;
}

/* One colored geometry for each body. */
function shapes(model) {
  const bodies = new Map();
  for (let geom = 0; geom < model.ngeom; geom++) {
    if (model.geom_group[geom] !== VISUAL) continue;
    const made = shape(model.geom_type[geom], model.geom_size.subarray(3 * geom, 3 * geom + 3));
    if (!made) continue;
    const [w, x, y, z] = model.geom_quat.subarray(4 * geom, 4 * geom + 4);
    made.applyQuaternion(new THREE.Quaternion(x, y, z, w)).translate(...model.geom_pos.subarray(3 * geom, 3 * geom + 3));
    const material = model.geom_matid[geom];
    const rgb = material >= 0 ? model.mat_rgba.subarray(4 * material, 4 * material + 3) : model.geom_rgba.subarray(4 * geom, 4 * geom + 3);
    const color = new THREE.Color().setRGB(...rgb, THREE.SRGBColorSpace), count = made.attributes.position.count;
    made.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count).map((_, index) => color.toArray()[index % 3]), 3));
    const body = model.geom_bodyid[geom];
    bodies.set(body, [...(bodies.get(body) || []), made.toNonIndexed()]);
  }
  return new Map([...bodies].map(([body, list]) => [body, mergeGeometries(list)]));
}

/* Texture of a floor with lines, repeated. */
function tiles(count, color, line) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 128;
  const pen = canvas.getContext("2d");
  pen.fillStyle = color;
  pen.fillRect(0, 0, 128, 128);
  pen.strokeStyle = line;
  pen.lineWidth = 3;
  pen.strokeRect(0, 0, 128, 128);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.repeat.set(count, count);
  texture.anisotropy = 8;
  return texture;
}

/* How far a body is from its place in another pose (m, and entries of a quaternion). */
function away(one, other, body) {
  const apart = (values, others, size) => Math.max(...values.subarray(size * body, size * (body + 1)).map((value, index) => Math.abs(value - others[size * body + index])));
  return Math.max(apart(one.pos, other.pos, 3), apart(one.quat, other.quat, 4));
}

class Figure {
  constructor(parent, geometries, look) {
    this.group = new THREE.Group();
    this.group.visible = false;
    this.look = look;
    this.meshes = [...geometries].map(([body, geometry]) => {
      const own = look.color === undefined;
      const material = new THREE.MeshLambertMaterial({ vertexColors: own, color: own ? 0xffffff : look.color, transparent: (look.opacity ?? 1) < 1, opacity: look.opacity ?? 1, depthWrite: (look.opacity ?? 1) > 0.5 });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.userData.body = body;
      mesh.castShadow = own;
      this.group.add(mesh);
      return mesh;
    });
    parent.add(this.group);
  }

  /* Draw bodies where they are, or hide them; `faint` bodies are only to be guessed, those `inside` others are red, and those
     that are where they are in the figure `beside` would flicker. */
  show(placed, { color, faint, inside, beside } = {}) {
    this.group.visible = placed !== null;
    if (!placed) return;
    for (const mesh of this.meshes) {
      const { body } = mesh.userData;
      mesh.position.set(...placed.pos.subarray(3 * body, 3 * body + 3));
      const [w, x, y, z] = placed.quat.subarray(4 * body, 4 * body + 4);
      mesh.quaternion.set(x, y, z, w);
      mesh.visible = !beside || away(placed, beside, body) > SAME;
      if (this.look.color === undefined) continue;
      mesh.material.color.set(inside && inside.has(body) ? RED : color ?? this.look.color);
      const opacity = (this.look.opacity ?? 1) * (faint && faint.has(body) ? 0.22 : 1);
      const { material } = mesh;
      if (material.transparent !== opacity < 1) material.needsUpdate = true; // it is compiled for the one or the other
      Object.assign(material, { opacity, transparent: opacity < 1, depthWrite: opacity > 0.5 });
    }
  }
}

export class Scene {
  constructor(host, robot, { grab, drag, release, choose, clickBody, grabJoint, turnJoint }) {
    this.robot = robot;
    const canvas = document.createElement("canvas"); // in the page before it is drawn on: early.js looks for that
    host.append(canvas);
    const renderer = (this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true }));
    renderer.setPixelRatio(window.platSoftware ? 1 : Math.min(devicePixelRatio, 2));
    renderer.shadowMap.enabled = !window.platSoftware;
    const { sky, tile, line, light } = matchMedia("(prefers-color-scheme: dark)").matches ? DARK : BRIGHT;
    const scene = (this.scene = new THREE.Scene());
    scene.background = new THREE.Color(sky);
    scene.fog = new THREE.Fog(sky, 8, 22);
    const camera = (this.camera = new THREE.PerspectiveCamera(45, 1, 0.05, 100));
    camera.up.set(0, 0, 1);
    camera.position.set(2.1, -1.45, 1.15);
    this.orbit = new OrbitControls(camera, renderer.domElement);
    this.orbit.target.set(0, 0, 0.63);
    this.orbit.update();
    this.orbit.addEventListener("change", () => this.draw());
    scene.add(new THREE.HemisphereLight(0xffffff, 0xa0a8b2, light));
    const sun = new THREE.DirectionalLight(0xffffff, light);
    sun.position.set(1.5, -1.5, 4);
    sun.castShadow = true;
    Object.assign(sun.shadow.camera, { left: -2, right: 2, top: 2, bottom: -2, far: 9 });
    sun.shadow.mapSize.set(1024, 1024);
    scene.add(sun, sun.target);
    this.sun = sun;
    const world = (this.world = new THREE.Group()), beside = (this.beside = new THREE.Group());
    beside.position.set(0, 1, 0);
    world.add(beside);
    scene.add(world);
    const floor = new THREE.Mesh(new THREE.PlaneGeometry(60, 60), new THREE.MeshLambertMaterial({ map: tiles(60 / 0.5, tile, line) }));
    floor.receiveShadow = true;
    world.add(floor);
    const geometries = shapes(robot.model), figure = (parent, look) => new Figure(parent, geometries, look);
    this.figures = {
      robot: figure(world, {}), second: figure(beside, {}), pose: figure(world, { color: 0x12b76a }),
      goal: figure(world, { color: 0x12b76a, opacity: 0.35 }), goal2: figure(beside, { color: 0x12b76a, opacity: 0.35 }),
      before: figure(world, { color: 0x3c6edc, opacity: 0.18 }), after: figure(world, { color: ORANGE, opacity: 0.18 }),
    };
    this.support = new THREE.LineLoop(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    this.plumb = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    this.spot = new THREE.Mesh(new THREE.SphereGeometry(0.022, 12, 8), new THREE.MeshBasicMaterial());
    this.stance = new THREE.Group();
    this.stance.add(this.support, this.plumb, this.spot);
    world.add(this.stance);
    this.balls = Object.fromEntries(Object.keys(robot.site.handles).map((name) => {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(/(elbow|knee)$/.test(name) ? 0.026 : 0.033, 16, 10), new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.85, depthTest: false }));
      ball.renderOrder = 2;
      ball.userData.handle = name;
      world.add(ball);
      return [name, ball];
    }));
    // arrows and rings on an object that is where the handle is
    this.grip = new THREE.Object3D();
    this.arrows = false;
    world.add(this.grip);
    this.gizmos = ["translate", "rotate"].map((mode) => {
      const gizmo = new TransformControls(camera, renderer.domElement);
      gizmo.setMode(mode);
      gizmo.setSize(mode === "translate" ? 0.55 : 0.42);
      gizmo.setSpace("local");
      gizmo.attach(this.grip);
      gizmo.addEventListener("dragging-changed", ({ value }) => {
        this.orbit.enabled = !value;
        this.dragging = value;
        if (value) grab(); else release();
      });
      gizmo.addEventListener("objectChange", () => drag(this.target()));
      gizmo.addEventListener("change", () => this.draw());
      scene.add(gizmo.getHelper());
      return gizmo;
    });
    // and a ring about the axis of a joint
    this.axle = new THREE.Object3D();
    this.ringed = false;
    world.add(this.axle);
    const ring = (this.ring = new TransformControls(camera, renderer.domElement));
    ring.setMode("rotate");
    ring.setSize(0.5);
    ring.setSpace("local");
    Object.assign(ring, { showX: false, showY: false });
    ring.setColors(ORANGE, ORANGE, ORANGE, BLUE);
    ring.attach(this.axle);
    ring.addEventListener("dragging-changed", ({ value }) => {
      this.orbit.enabled = !value;
      this.dragging = value;
      if (value) grabJoint(); else release();
    });
    ring.addEventListener("objectChange", () => { const { quaternion: q } = this.axle; turnJoint([q.w, q.x, q.y, q.z]); });
    ring.addEventListener("change", () => this.draw());
    scene.add(ring.getHelper());
    const ray = new THREE.Raycaster(), { domElement } = renderer;
    const aim = ({ clientX, clientY }) => {
      const box = domElement.getBoundingClientRect();
      ray.setFromCamera(new THREE.Vector2(((clientX - box.left) / box.width) * 2 - 1, 1 - ((clientY - box.top) / box.height) * 2), camera);
    };
    let pressed = null, pulled = null; // where the mouse went down, and the ball that it has
    host.addEventListener("pointerdown", (event) => { // before the view takes it
      pressed = [event.clientX, event.clientY];
      if (event.button !== 0 || [...this.gizmos, ring].some((gizmo) => gizmo.enabled && gizmo.axis !== null)) return;
      aim(event);
      // of several on top of each other the one whose center is nearest
      const off = ({ object, distance }) => ray.ray.distanceToPoint(object.getWorldPosition(new THREE.Vector3())) / distance;
      const ball = ray.intersectObjects(Object.values(this.balls).filter((one) => one.visible)).sort((a, b) => off(a) - off(b))[0];
      if (!ball) return;
      this.orbit.enabled = false;
      domElement.setPointerCapture(event.pointerId);
      pulled = { name: ball.object.userData.handle, from: ball.point, target: null };
      // the place of the robot is moved along the floor, all else across the line of sight
      const normal = robot.site.handles[pulled.name].body === null ? camera.up.clone() : camera.getWorldDirection(new THREE.Vector3());
      pulled.plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, ball.point);
      choose(pulled.name);
    }, true);
    domElement.addEventListener("pointermove", (event) => {
      if (!pulled || (pulled.target === null && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) <= 4)) return;
      if (pulled.target === null) {
        pulled.target = this.target();
        this.arrows = false; // they would be in the way of the next drag
        grab();
      }
      aim(event);
      const to = ray.ray.intersectPlane(pulled.plane, new THREE.Vector3());
      if (to) drag({ pos: to.sub(pulled.from).toArray().map((value, axis) => value + pulled.target.pos[axis]), quat: pulled.target.quat });
    });
    const letGo = () => {
      const { name, target } = pulled ?? {};
      this.orbit.enabled = true;
      pulled = null;
      if (target) release();
      else if (name) { this.arrows = true; choose(name); }
    };
    domElement.addEventListener("pointercancel", letGo);
    domElement.addEventListener("pointerup", (event) => {
      if (pulled) { letGo(); return; }
      if (!pressed || this.dragging || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      aim(event);
      const hit = this.figures.pose.group.visible && ray.intersectObjects(this.figures.pose.meshes)[0];
      if (hit) clickBody(hit.object.userData.body);
    });
    new ResizeObserver(() => {
      const { clientWidth: width, clientHeight: height } = host;
      if (!width || !height) return;
      renderer.setSize(width, height);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      this.draw();
    }).observe(host);
  }

  target() {
    const { position, quaternion: q } = this.grip;
    return { pos: position.toArray(), quat: [q.w, q.x, q.y, q.z] };
  }

  /* Handles at their frames: `pins` are those that are commanded. */
  showHandles(frames, chosen, pins, visible, axle) {
    for (const [name, ball] of Object.entries(this.balls)) {
      ball.visible = visible;
      const { pos, quat: [w, x, y, z] } = frames[name], away = new THREE.Vector3(...this.robot.site.handles[name].ball);
      ball.position.set(...pos).add(away.applyQuaternion(new THREE.Quaternion(x, y, z, w)));
      ball.material.color.set(name === chosen && !this.ringed ? BLUE : pins.has(name) ? ORANGE : PALE);
    }
    for (const gizmo of this.gizmos) {
      gizmo.getHelper().visible = visible && this.arrows && (gizmo.mode === "translate" || !/(elbow|knee)$/.test(chosen));
      gizmo.enabled = visible && this.arrows;
    }
    this.ring.enabled = this.ring.getHelper().visible = visible && this.ringed;
    if (this.dragging) return;
    for (const [object, { pos, quat: [w, x, y, z] }] of [[this.grip, frames[chosen]], [this.axle, axle]]) {
      object.position.set(...pos);
      object.quaternion.set(x, y, z, w);
    }
  }

  showStance(stance) {
    this.stance.visible = stance !== null;
    if (!stance) return;
    const color = stance.margin !== null && stance.margin >= 0 ? GREEN : RED, [x, y, z] = stance.center;
    this.support.geometry.dispose();
    this.support.geometry = new THREE.BufferGeometry().setFromPoints(stance.support.map((corner) => new THREE.Vector3(...corner, 0.006)));
    this.plumb.geometry.dispose();
    this.plumb.geometry = new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(x, y, 0.006), new THREE.Vector3(x, y, z)]);
    this.spot.position.set(x, y, 0.006);
    for (const part of [this.support, this.plumb, this.spot]) part.material.color.set(color);
  }

  get worldAxes() { return this.gizmos[0].space === "world"; }
  toggleAxes() { Object.assign(this, { arrows: true, ringed: false }); for (const gizmo of this.gizmos) gizmo.setSpace(gizmo.space === "local" ? "world" : "local"); this.draw(); }

  /* Move the camera to a place, where the world that moves under a robot shows it. */
  look([x, y]) {
    const { target } = this.orbit, { position } = this.world, shift = new THREE.Vector3(x + position.x - target.x, y + position.y - target.y, 0);
    target.add(shift);
    this.camera.position.add(shift);
    this.orbit.update();
  }

  /* Draw at the next frame. */
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    const paint = () => { this.waiting = false; this.renderer.render(this.scene, this.camera); };
    requestAnimationFrame(paint);
    clearTimeout(this.rest);
    if (window.platSoftware) this.rest = setTimeout(() => requestAnimationFrame(paint), REST); // in all pixels
  }
}
