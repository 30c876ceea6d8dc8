/* The studio's timeline, keyboard and messages. All decisions are the server's: what a user does is sent as
   {"do": ...}, and what is to be seen comes back as the state. */
(() => {
  "use strict";
  const state = { timeline: null, time: null, notes: [], busy: [], file: null, check: null, view: {} };
  const SVG = "http://www.w3.org/2000/svg";
  const COLORS = { reached: "#12a15e", late: "#f76707", fell: "#d6363b", waiting: "#8593a0" };
  let socket = null, lastNote = null, drag = null, zoom = null, framed = null, soon = null, opened = false;

  // what is sent

  function send(what, more) {
    if (window.platChannel) window.platChannel.send({ do: what, ...more }); // a page without a server
    else if (socket && socket.readyState === 1) socket.send(JSON.stringify({ do: what, ...more }));
  }

  function sendSoon(what, more) { // at most once a frame
    if (soon === null) requestAnimationFrame(flush);
    soon = [what, more];
  }

  function flush() {
    if (soon !== null) send(...soon);
    soon = null;
  }

  function told(news) {
    Object.assign(state, news);
    if (news.notes) showNotes();
    show();
  }

  function connect() {
    if (window.platChannel) {
      window.platChannel.listen(told);
      return;
    }
    const where = location.href.split("?")[0].replace(/^http/, "ws").replace(/\/$/, "") + "/dock" + location.search;
    socket = new WebSocket(where);
    socket.onopen = () => send("browser", { software: window.platSoftware === true });
    socket.onmessage = (event) => told(JSON.parse(event.data));
    socket.onclose = () => {
      if (opened) cover("The studio has stopped.", "Start it again in the terminal: plat studio. This page comes back by itself; what you made is in its autosave.");
      setTimeout(connect, 1000);
    };
  }

  // the page

  function make(tag, attributes, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes || {})) {
      if (name.startsWith("on")) element[name] = value;
      else if (name === "text") element.textContent = value;
      else element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  }

  function draw(tag, attributes, ...children) {
    const element = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes || {})) element.setAttribute(name, value);
    element.append(...children);
    return element;
  }

  const at = {}; // elements by name
  function button(name, text, hint, action) {
    at[name] = make("button", { text, title: hint, "aria-label": hint.split(" (")[0], onclick: () => { action(); at[name].blur(); } });
    return at[name];
  }

  function primary(element) {
    element.classList.add("play");
    return element;
  }

  function field(name, kind, label, what) {
    at[name] = make("input", { class: kind, "aria-label": label, title: label });
    const commit = () => send(what, { value: kind === "number" ? Number(at[name].value) : at[name].value });
    at[name].onchange = commit;
    at[name].onkeydown = (event) => { if (event.key === "Enter") at[name].blur(); };
    return at[name];
  }

  function build() {
    const gap = () => make("span", { class: "gap" });
    at.speed = make("select", { "aria-label": "Speed", title: "Speed of playback", onchange: () => { send("speed", { value: at.speed.value }); at.speed.blur(); } },
      ...["1x", "1/2", "1/4", "1/10"].map((label) => make("option", { text: label, value: label })));
    at.clock = make("span", { class: "clock" });
    at.track = draw("svg", { class: "track", role: "group", "aria-label": "timeline" });
    at.words = make("span", { class: "words", role: "status" });
    at.file = make("span", { class: "file" });
    at.dock = make("div", { id: "dock" },
      make("div", { class: "bar" },
        primary(button("play", "Play", "Play or pause (space)", () => send("toggle"))),
        button("stop", "■", "Stop and go to the start (Esc)", () => send("stop")),
        button("back", "◂", "A step back (,)", () => send("step", { value: -1 })),
        button("ahead", "▸", "A step ahead (.)", () => send("step", { value: 1 })),
        at.speed,
        button("loop", "⟲", "Loop (L)", () => send("loop")),
        at.clock, gap(),
        button("add", "Add", "Add a keyframe (A)", () => send("add")),
        button("copy", "Copy", "Copy (Ctrl+C)", () => send("copy")),
        button("paste", "Paste", "Paste (Ctrl+V)", () => send("paste")),
        button("mirror", "Mirror", "Mirror left and right (M)", () => send("mirror")),
        button("remove", "Delete", "Delete (Del)", () => send("remove")),
        button("undo", "↶", "Undo (Ctrl+Z)", () => send("undo")),
        button("redo", "↷", "Redo (Ctrl+Shift+Z)", () => send("redo")),
        gap(), field("name", "name", "Name", "rename"),
        make("label", { text: "takes" }), field("interval", "number", "Takes (s)", "interval"),
        make("label", { text: "held" }), field("hold", "number", "Held (s)", "hold"),
        make("span", { class: "fill" }),
        button("out", "−", "Zoom out (-)", () => zoomBy(1 / 1.5)),
        button("in", "+", "Zoom in (+)", () => zoomBy(1.5)),
        button("fit", "Fit", "Fit all (0)", () => { zoom = null; show(); }),
        button("help", "?", "Help: all keys (?)", () => help())),
      at.track,
      make("div", { class: "status" }, at.words, at.file));
    at.pill = make("div", { class: "dock-pill", role: "status" }, make("span", { class: "dock-spin" }), at.pillText = make("span"));
    at.notes = make("div", { id: "dock-notes", role: "alert" });
    at.cover = make("div", { id: "dock-cover" }, make("span", { class: "dock-spin" }), at.coverTitle = make("b"), at.coverText = make("span"));
    at.sheet = make("div", { id: "dock-help", role: "dialog", "aria-label": "Help", onclick: () => help(false) }, helpSheet());
    document.body.append(at.dock, at.pill, at.notes, at.cover, at.sheet);
    cover("plat keyframe studio", "Loading the robot …");
    at.track.addEventListener("pointerdown", down);
    at.track.addEventListener("pointermove", move);
    at.track.addEventListener("pointerup", up);
    at.track.addEventListener("pointercancel", up);
    at.track.addEventListener("dblclick", twice);
    at.track.addEventListener("wheel", wheel, { passive: false });
    new ResizeObserver(show).observe(at.track);
    window.addEventListener("keydown", key, true);
    window.addEventListener("beforeunload", () => send("leave"));
  }

  function cover(title, text) {
    at.coverTitle.textContent = title;
    at.coverText.textContent = text;
    at.cover.style.display = "flex";
  }

  // time and pixels

  function frame() {
    const width = at.track.clientWidth || 800, left = 34, right = 34;
    if (zoom) return { width, left, from: zoom.from, scale: zoom.scale };
    if (drag && framed) return framed; // the scale stays while something is dragged
    const end = Math.max(state.timeline.duration, state.time ? state.time.simulated : 0, 1.4) + 0.6;
    return { width, left, from: 0, scale: (width - left - right) / end };
  }

  const toX = (time) => framed.left + (time - framed.from) * framed.scale;
  const toTime = (x) => Math.max((x - framed.left) / framed.scale + framed.from, 0);

  function zoomBy(factor, x) {
    if (!framed) return;
    x = x === undefined ? toX(state.time.cursor) : x;
    const time = (x - framed.left) / framed.scale + framed.from;
    const scale = Math.min(Math.max(framed.scale * factor, 15), 2500);
    zoom = { scale, from: Math.max(time - (x - framed.left) / scale, 0) };
    show();
  }

  function wheel(event) {
    event.preventDefault();
    if (!framed) return;
    const across = event.shiftKey ? event.deltaY : event.deltaX;
    if (Math.abs(across) > Math.abs(event.shiftKey ? 0 : event.deltaY)) {
      zoom = { scale: framed.scale, from: Math.max(framed.from + across / framed.scale, 0) };
      show();
    } else zoomBy(Math.exp(-event.deltaY / 300), event.clientX - at.track.getBoundingClientRect().left);
  }

  // pointer

  function place(event) {
    return event.clientX - at.track.getBoundingClientRect().left;
  }

  function snapped(x) {
    let best = toTime(x), near = 6;
    for (const pose of state.timeline.poses) {
      const away = Math.abs(toX(pose.time) - x);
      if (away < near) { near = away; best = pose.time; }
    }
    return best;
  }

  function down(event) {
    if (event.button !== 0 || !state.timeline) return;
    const target = event.target.closest("[data-key],[data-edge]"), x = place(event);
    at.track.setPointerCapture(event.pointerId);
    if (document.activeElement && document.activeElement.blur) document.activeElement.blur();
    if (target && target.dataset.edge !== undefined) {
      const number = Number(target.dataset.edge);
      drag = { kind: "hold", number, x, moved: true };
      send("select", { number });
    } else if (target) {
      const number = Number(target.dataset.key);
      drag = { kind: "key", number, x, grip: x - toX(state.timeline.poses[number].time), moved: false };
      send("select", { number });
    } else {
      drag = { kind: "seek", x, moved: true };
      send("seek", { time: snapped(x) });
    }
    event.preventDefault();
  }

  function move(event) {
    if (!drag) return;
    const x = place(event);
    if (!drag.moved && Math.abs(x - drag.x) < 4) return;
    drag.moved = true;
    if (drag.kind === "seek") sendSoon("seek", { time: snapped(x) });
    else if (drag.kind === "key" && drag.number > 0) sendSoon("retime", { number: drag.number, time: toTime(x - drag.grip) });
    else if (drag.kind === "hold") sendSoon("hold", { value: Math.max(toTime(x) - state.timeline.poses[drag.number].time, 0) });
  }

  function up() {
    if (!drag) return;
    flush();
    if (drag.kind !== "seek") send("end");
    drag = null;
    show();
  }

  function twice(event) {
    if (!event.target.closest("[data-key],[data-edge]")) send("add", { time: toTime(place(event)) });
  }

  // keys

  const KEYS = {
    " ": ["toggle"], Escape: ["stop"], Delete: ["remove"], Backspace: ["remove"], a: ["add"], m: ["mirror"], l: ["loop"], f: ["look"], h: ["hide"],
    w: ["axes"], p: ["pin"], o: ["onion"], t: ["stand"], g: ["floor"],
    ArrowLeft: ["previous"], ArrowRight: ["next"], ",": ["step", { value: -1 }], ".": ["step", { value: 1 }], "<": ["step", { value: -10 }], ">": ["step", { value: 10 }],
    Home: ["first"], End: ["last"], "[": ["nudge", { value: -1 }], "]": ["nudge", { value: 1 }],
  };
  const CONTROL = { c: ["copy"], x: ["cut"], v: ["paste"], s: ["save"], z: ["undo"], y: ["redo"], Z: ["redo"] };

  function typing(element) {
    return element && (element.isContentEditable || ["TEXTAREA", "SELECT"].includes(element.tagName)
      || (element.tagName === "INPUT" && !["checkbox", "radio", "button", "range"].includes(element.type)));
  }

  function key(event) {
    const control = event.ctrlKey || event.metaKey;
    if (typing(event.target) && !(control && event.key === "s")) return;
    if (event.altKey) return;
    let what = control ? CONTROL[event.key] || CONTROL[event.key.toLowerCase()] : KEYS[event.key] || KEYS[event.key.toLowerCase()];
    if (control && event.shiftKey && event.key.toLowerCase() === "z") what = ["redo"];
    if (control && event.key === "c" && String(getSelection())) return; // text that is marked is copied as text
    let done = true;
    if (event.key === "Escape" && at.sheet.classList.contains("shown")) help(false);
    else if (!control && event.key === "?") help();
    else if (!control && (event.key === "+" || event.key === "=")) zoomBy(1.5);
    else if (!control && event.key === "-") zoomBy(1 / 1.5);
    else if (!control && event.key === "0") { zoom = null; show(); }
    else if (event.key === "Escape" && document.querySelector("[role=dialog]:not(#dock-help)")) return;
    else if (what) send(...what);
    else done = false;
    if (done) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
  }

  function help(on) {
    at.sheet.classList.toggle("shown", on);
  }

  function helpSheet() {
    const parts = {
      "Play": [["space", "play, pause, go on"], ["Esc", "stop, to the start"], [", .", "a control step back, ahead"], ["< >", "ten steps"], ["L", "loop"]],
      "Keyframes": [["A", "add: at the playhead, or after the selected one"], ["← →", "select the one before, after"], ["[ ]", "a step earlier, later"],
        ["Del", "delete"], ["Ctrl C X V", "copy, cut, paste"], ["Ctrl Z", "undo; with Shift: redo"], ["Ctrl S", "save"], ["Home End", "first, last"]],
      "Pose": [["M", "mirror left and right"], ["T", "stand"], ["G", "lowest point on the floor"], ["P", "command the handle, or leave it to the policy"], ["W", "handle along the world or the limb"], ["F", "look at the pose"],
        ["H", "hide the robot while posing"], ["O", "poses before and after on, off"]],
      "Mouse, in the timeline": [["click", "select a keyframe; elsewhere: move the playhead"], ["drag", "a keyframe to another time; its right edge to hold it"],
        ["double click", "add a keyframe there"], ["wheel", "zoom; with Shift: move"], ["+ - 0", "zoom in, out, fit"]],
      "Mouse, in the scene": [["ball", "click it, then drag its arrows and rings"], ["limb", "click it to turn its joint"], ["drag", "turn the view; right button: move it"], ["wheel", "nearer, farther"]],
    };
    const columns = make("div", { class: "columns" });
    for (const [title, rows] of Object.entries(parts)) {
      const table = make("table");
      for (const [keys, text] of rows) {
        const cell = make("td");
        for (const one of keys.length > 9 || /^[a-z]/.test(keys) ? [keys] : keys.split(" ")) cell.append(make("kbd", { text: one }), " ");
        table.append(make("tr", {}, cell, make("td", { text })));
      }
      columns.append(make("section", {}, make("h3", { text: title }), table));
    }
    return make("div", {}, make("h2", { text: "Keys and mouse" }), columns);
  }

  // what is shown

  function showNotes() {
    if (lastNote === null) lastNote = Math.max(0, ...state.notes.map((note) => note.id)) - (opened ? 1 : 0);
    for (const note of state.notes) {
      if (note.id <= lastNote) continue;
      lastNote = note.id;
      showNote(note);
    }
  }

  function showNote(note) {
    const box = make("div", { class: `note ${note.kind}` }, make("b", { text: note.title }), make("span", { text: note.text }),
      make("button", { text: "×", "aria-label": "Close", onclick: () => box.remove() }));
    at.notes.append(box);
    while (at.notes.children.length > 4) at.notes.firstChild.remove();
    setTimeout(() => box.remove(), note.kind === "error" ? 15000 : 6000);
  }

  function show() {
    const { timeline, time } = state;
    if (!timeline || !time || !at.dock) return;
    if (!opened || at.cover.style.display !== "none") uncover();
    const pose = timeline.poses[timeline.selected], playing = time.mode === "playing", first = timeline.selected === 0;
    at.play.textContent = playing ? "❚❚ Pause" : time.mode === "paused" ? "▶ Go on" : "▶ Play";
    at.play.disabled = timeline.poses.length === 1;
    at.loop.classList.toggle("on", time.loop);
    if (document.activeElement !== at.speed) at.speed.value = time.speed;
    at.clock.textContent = `${time.cursor.toFixed(2)} / ${Math.max(timeline.duration, 0).toFixed(2)} s`;
    at.undo.disabled = !timeline.undo;
    at.redo.disabled = !timeline.redo;
    at.paste.disabled = !timeline.paste;
    at.remove.disabled = at.name.disabled = at.interval.disabled = at.hold.disabled = first;
    fill(at.name, first ? "start" : pose.name);
    fill(at.interval, first ? "" : String(timeline.interval));
    fill(at.hold, first ? "" : String(pose.hold));
    showWords(pose);
    at.file.textContent = state.file ? `${state.file.name}${state.file.unsaved ? " · not saved" : ""}${state.file.autosave ? " · " + state.file.autosave : ""}` : "";
    document.title = `${state.file && state.file.unsaved ? "• " : ""}${state.file ? state.file.name + " – " : ""}plat keyframe studio`;
    at.pill.classList.toggle("shown", state.busy.length > 0);
    at.pillText.textContent = state.busy.join(" · ");
    showTrack(timeline, time);
  }

  function uncover() {
    if (!document.querySelector("#root canvas")) { setTimeout(show, 100); return; }
    at.cover.style.display = "none";
    if (!opened && state.file && state.file.restorable)
      showNote({ kind: "error", title: "Autosave", text: "Keyframes of an earlier session were not saved: Files, Restore autosave." });
    opened = true;
  }

  function fill(input, value) {
    if (document.activeElement !== input && input.value !== value) input.value = value;
  }

  function showWords(pose) {
    at.words.replaceChildren();
    if (pose.result) at.words.append(make("span", { class: pose.status === "reached" ? "good" : "bad", text: pose.result }), "  ·  ");
    if (pose.words.length) at.words.append(make("span", { class: "bad", text: pose.words.join("; ") }));
    else at.words.append(make("span", { text: [state.check, pose.joint && `fastest: ${pose.joint} ${pose.speed.toFixed(1)} rad/s`].filter(Boolean).join("  ·  ") }));
    at.words.title = at.words.textContent;
  }

  function mixed(share) { // green, amber, red
    return share > 1 ? "#d6363b" : share > 0.6 ? "#e08700" : "#a8c8b5";
  }

  function showTrack(timeline, time) {
    framed = frame();
    const height = at.track.clientHeight || 90, axis = 30, middle = Math.round(axis + (height - axis) * 0.42), parts = [];
    const step = [0.02, 0.1, 0.2, 0.5, 1, 2, 5, 10].find((unit) => unit * framed.scale > 46) || 10;
    const begin = Math.max(Math.floor(framed.from / step), 0), count = Math.ceil(framed.width / framed.scale / step) + 1;
    parts.push(draw("rect", { x: 0, y: 0, width: framed.width, height: axis - 8, fill: "#f4f6f8" }));
    for (let number = begin; number < begin + count; number++) {
      const x = toX(number * step), label = draw("text", { x, y: 15, "text-anchor": "middle" });
      label.textContent = `${+(number * step).toFixed(2)} s`;
      parts.push(draw("line", { x1: x, x2: x, y1: axis - 8, y2: height, stroke: "#eaeef1" }), label);
    }
    parts.push(...curves(height, axis));
    if (time.simulated > 0) parts.push(draw("rect", { x: toX(0), y: axis - 8, width: time.simulated * framed.scale, height: 3, fill: "#9cc4ea" }));
    let end = 0;
    timeline.poses.forEach((pose, number) => { // intervals, in the color of their fastest joint
      if (number > 0) {
        const line = draw("line", { x1: toX(end), x2: toX(pose.time), y1: middle, y2: middle, stroke: mixed(pose.share), "stroke-width": 5, "data-share": pose.share });
        line.append(tip(`${pose.joint} at up to ${pose.speed.toFixed(1)} rad/s`));
        parts.push(line);
      }
      end = pose.time + pose.hold;
    });
    for (const mark of timeline.marks) parts.push(draw("circle", { cx: toX(mark), cy: middle, r: 3, fill: "#fff", stroke: "#8593a0" }));
    timeline.poses.forEach((pose, number) => {
      const x = toX(pose.time), chosen = number === timeline.selected, size = chosen ? 10 : 8, color = COLORS[pose.status];
      const group = draw("g", { class: chosen ? "key chosen" : "key", "data-key": number, role: "button", "aria-label": `keyframe ${pose.label}`, "aria-pressed": chosen });
      if (pose.hold > 0) group.append(draw("rect", { x, y: middle - 7, width: pose.hold * framed.scale, height: 14, rx: 4, fill: color, opacity: 0.4 }));
      group.append(draw("rect", { x: x - 12, y: axis - 4, width: 24, height: height - axis, fill: "transparent" }),
        draw("path", { d: `M${x} ${middle - size} l${size} ${size} l${-size} ${size} l${-size} ${-size}z`, fill: color, stroke: chosen ? "#1c7ed6" : "#fff", "stroke-width": chosen ? 3 : 2 }));
      if (pose.words.length) {
        const sign = draw("text", { x, y: middle - size - 3, "text-anchor": "middle", style: "fill:#d6363b;font-weight:700" });
        sign.textContent = "▲!";
        group.append(sign);
      }
      const text = draw("text", { x, y: middle + size + 13 + (number % 2 ? 12 : 0), "text-anchor": "middle" });
      text.textContent = pose.label.length > 14 ? pose.label.slice(0, 13) + "…" : pose.label;
      group.append(text, tip([pose.label, `${pose.time.toFixed(2)} s`, pose.result, ...pose.words].filter(Boolean).join("\n")));
      parts.push(group);
      if (number > 0) {
        const edge = x + Math.max(pose.hold * framed.scale, size + 2);
        if (chosen || pose.hold > 0)
          parts.push(draw("rect", { class: "edge", "data-edge": number, x: edge - 3, y: middle - 10, width: 8, height: 20, rx: 3, fill: chosen ? "#1c7ed6" : "#b9c4ce", opacity: 0.75 }, tip("Drag to hold the pose")));
      }
    });
    const now = toX(time.cursor);
    parts.push(draw("path", { d: `M${now - 6} 0 h12 v8 l-6 7 l-6 -7z`, fill: "#f08c00", "pointer-events": "none" }),
      draw("line", { x1: now, x2: now, y1: 10, y2: height, stroke: "#f08c00", "stroke-width": 2, "pointer-events": "none", "data-playhead": time.cursor }));
    at.track.replaceChildren(...parts);
  }

  function curves(height, axis) { // how far each robot was from its keyframe, at the foot of the track
    const { dt, of } = state.distances || { of: [] }, colors = ["#1c7ed6", "#e8590c"];
    const most = Math.max(0.1, ...of.flat()), high = 0.5 * (height - axis);
    return of.flatMap((values, robot) => {
      if (values.length < 2) return [];
      const points = values.map((value, step) => `${toX((step + 1) * dt).toFixed(1)},${(height - 2 - (high * value) / most).toFixed(1)}`);
      const line = draw("polyline", { points: points.join(" "), fill: "none", stroke: colors[robot], "stroke-width": 1.5, opacity: 0.75, "data-distance": robot });
      line.append(tip("mean distance of the commanded bodies from the keyframe"));
      const last = values[values.length - 1], label = draw("text", { x: toX(values.length * dt) + 4, y: height - 2 - (high * last) / most, style: `fill:${colors[robot]}` });
      label.textContent = `${last.toFixed(2)} m`;
      return [line, label];
    });
  }

  function tip(text) {
    const title = draw("title");
    title.textContent = text;
    return title;
  }

  function count() { // how many frames a second this browser draws, while a robot plays
    let frames = 0, since = performance.now();
    const frame = (now) => {
      frames += 1;
      if (now - since > 1000) {
        if (state.time && state.time.mode === "playing") send("browser", { frames: (1000 * frames) / (now - since) });
        frames = 0;
        since = now;
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  build();
  connect();
  count();
})();
