/* The studio's timeline, keyboard and messages. All decisions are the server's: what a user does is sent as
   {"do": ...}, and what is to be seen comes back as the state. */
(() => {
  "use strict";
  const state = { timeline: null, time: null, notes: [], busy: [], file: null, check: null, view: {} };
  const SVG = "http://www.w3.org/2000/svg";
  const COLORS = { reached: "var(--green)", late: "var(--late)", fell: "var(--red)", waiting: "var(--idle)" };
  const ICONS = {
    play: "M5 3v10l8-5z", pause: "M5 3.5v9M11 3.5v9", stop: "M4 4h8v8H4z", back: "M11 3.5v9L5.5 8zM4 3.5v9", ahead: "M5 3.5v9L10.5 8zM12 3.5v9",
    loop: "M3 7a5 5 0 0 1 9-2.2L13 6M13 2.8V6H9.8M13 9a5 5 0 0 1-9 2.2L3 10M3 13.2V10h3.2", undo: "M6 3 3 6l3 3M3 6h6.5a3.5 3.5 0 0 1 0 7H6", redo: "M10 3l3 3-3 3M13 6H6.5a3.5 3.5 0 0 0 0 7H10",
  };
  const SENT = 60; // ms; the panel sends of every 50 ms the latest message only, whatever it is of: a click at once after typing would replace the text
  let socket = null, lastNote = null, asked = null, typed = -Infinity, tabbed = false, drag = null, zoom = null, framed = null, soon = null, opened = false, counting = false;

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
    if ("question" in news) showQuestion();
    show();
  }

  function connect() {
    if (window.platChannel) {
      window.platChannel.listen(told);
      return;
    }
    const where = `${location.origin.replace(/^http/, "ws")}${location.pathname.replace(/\/$/, "")}/dock${location.search}`;
    socket = new WebSocket(where);
    socket.onopen = () => {
      send("end"); // of a drag in which the page was loaded anew
      send("browser", { software: window.platSoftware === true, dark: matchMedia("(prefers-color-scheme: dark)").matches });
    };
    socket.onmessage = (event) => told(JSON.parse(event.data));
    socket.onclose = () => {
      state.file = null; // the page waits for the next studio's: it may know of unsaved work
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
    at[name] = make("button", { text, title: hint, "aria-label": hint.split(" (")[0], onclick: action });
    if (text in ICONS) at[name].replaceChildren(icon(text));
    return at[name];
  }

  function icon(name) {
    return draw("svg", { class: "icon", viewBox: "0 0 16 16", "aria-hidden": true }, draw("path", { d: ICONS[name] }));
  }

  function primary(element) {
    element.classList.add("play");
    return element;
  }

  function field(name, kind, label, what, least = () => 0) {
    at[name] = make("input", { class: kind, "aria-label": label, title: label, ...(kind === "number" ? {} : { maxlength: 60 }) });
    const commit = () => {
      const text = at[name].value, value = kind === "number" ? Number(text.replace(",", ".")) : text;
      const refused = kind === "number" && !(text.trim() && value >= least() && value <= state.timeline.longest);
      if (!refused) send(what, { value, number: meant ?? state.timeline.selected });
      else showNote({ kind: "error", title: "That did not work", text: `${label} is ${text.trim() ? `"${text}"` : "empty"}, expected a number from ${least()} to ${state.timeline.longest}.` });
      setTimeout(show, refused ? 0 : 800); // what is refused is not left standing
    };
    let meant; // the keyframe that was selected when the user began: another page may select another one meanwhile
    at[name].onfocus = () => { meant = state.timeline.selected; };
    at[name].onchange = commit;
    at[name].onkeydown = (event) => { if (event.key === "Enter") at[name].blur(); };
    return at[name];
  }

  function build() {
    const gap = () => make("span", { class: "gap" });
    at.speed = make("select", { "aria-label": "Speed", title: "Speed of playback", onchange: () => send("speed", { value: at.speed.value }) },
      ...["1x", "1/2", "1/4", "1/10"].map((label) => make("option", { text: label, value: label })));
    at.clock = make("span", { class: "clock" });
    at.track = draw("svg", { class: "track", role: "listbox", tabindex: 0, "aria-label": "keyframes" });
    at.words = make("span", { class: "words", role: "status" });
    at.file = make("span", { class: "file" });
    at.dock = make("div", { id: "dock" },
      make("div", { class: "bar" },
        primary(button("play", "", "Play or pause (space)", () => send("toggle"))),
        button("stop", "stop", "Stop and go to the start (Esc)", () => send("stop")),
        button("back", "back", "A step back (,)", () => send("step", { value: -1 })),
        button("ahead", "ahead", "A step ahead (.)", () => send("step", { value: 1 })),
        at.speed,
        button("loop", "loop", "Loop (L)", () => send("loop")),
        at.clock, gap(),
        button("add", "Add", "Add a keyframe (A)", () => send("add")),
        button("copy", "Copy", "Copy (Ctrl+C)", () => send("copy")),
        button("paste", "Paste", "Paste (Ctrl+V)", () => send("paste")),
        button("mirror", "Mirror", "Mirror left and right (M)", () => send("mirror")),
        button("remove", "Delete", "Delete (Del)", () => send("remove")),
        button("undo", "undo", "Undo (Ctrl+Z)", () => send("undo")),
        button("redo", "redo", "Redo (Ctrl+Shift+Z)", () => send("redo")),
        gap(), field("name", "name", "Name", "rename"),
        make("label", { text: "takes" }), field("interval", "number", "Takes (s)", "interval", () => state.distances.dt),
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
    at.sheet = make("dialog", { id: "dock-help", class: "dock-sheet", "aria-label": "Help", autofocus: "", onclick: (event) => { if (event.target === at.sheet) help(); } }, ...helpSheet());
    at.question = make("dialog", { class: "dock-sheet", "aria-label": "Question", onclose: () => answer(at.question.returnValue === "yes") });
    document.body.append(at.dock, at.pill, at.notes, at.cover, at.sheet, at.question);
    cover("plat keyframe studio", "Loading the robot …");
    at.track.addEventListener("pointerdown", down);
    at.track.addEventListener("pointermove", move);
    at.track.addEventListener("pointerup", up);
    at.track.addEventListener("pointercancel", up);
    at.track.addEventListener("dblclick", twice);
    at.track.addEventListener("wheel", wheel, { passive: false });
    new ResizeObserver(show).observe(at.track);
    window.addEventListener("keydown", key, true);
    window.addEventListener("pointerdown", () => { tabbed = false; }, true);
    window.addEventListener("input", (event) => {
      typed = performance.now();
      // the panel would show -0 as 0, and who types -0.5 would have 0.5
      if (event.target.matches(".mantine-NumberInput-input") && /^-0[.,]?0*$/.test(event.target.value)) event.stopImmediatePropagation();
    }, true);
    window.addEventListener("click", (event) => { // what was typed is sent first
      const button = event.target.closest?.("button");
      if (!button || at.dock.contains(button) || !unsent()) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (event.detail) button.blur();
      setTimeout(() => button.click(), SENT);
    }, true);
    window.addEventListener("click", ({ detail, target }) => { // the keys are the studio's again; who came by Tab stays
      if (!detail || !target.closest) return;
      target.closest("button")?.blur();
      if (target.closest("[role=option]")) setTimeout(() => document.activeElement?.blur()); // what was chosen in a list
    });
    window.addEventListener("change", ({ target }) => { if (target.tagName === "SELECT" && !tabbed) target.blur(); });
    window.addEventListener("dragover", (event) => { if (event.dataTransfer.types.includes("Files")) event.preventDefault(); });
    window.addEventListener("drop", (event) => { // else the browser would leave the page for the file
      const [file] = event.dataTransfer.files;
      if (!file || event.defaultPrevented) return;
      event.preventDefault();
      if (window.platChannel) window.platChannel.open(file);
      else showNote({ kind: "error", title: "That did not work", text: "Files are not dropped here: Files, Upload opens keyframe files." });
    });
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
      send("drag");
    } else if (target) {
      const number = Number(target.dataset.key);
      drag = { kind: "key", number, x, grip: x - toX(state.timeline.poses[number].time), moved: false };
      send("select", { number });
      send("drag");
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
    else if (drag.kind === "hold") sendSoon("hold", { number: drag.number, value: Math.max(toTime(x) - state.timeline.poses[drag.number].time, 0) });
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

  const unsent = () => performance.now() - typed < SENT;

  function typing(element) {
    return element && (element.isContentEditable || ["TEXTAREA", "SELECT"].includes(element.tagName)
      || (element.tagName === "INPUT" && !["checkbox", "radio", "button", "range"].includes(element.type)));
  }

  // space, Enter and arrows belong to what somebody has come to by Tab
  function operating(event) {
    return tabbed && [" ", "Enter", "ArrowLeft", "ArrowRight", "Home", "End"].includes(event.key)
      && event.target.matches("button, a, input, [role=tab], [role=slider]");
  }

  function key(event) {
    // brackets need AltGr or Option on many keyboards, and AltGr counts as Ctrl and Alt where Windows runs
    const third = event.altKey && ["[", "]"].includes(event.key), control = !third && (event.ctrlKey || event.metaKey);
    if (event.key === "Tab") tabbed = true;
    if (document.querySelector("dialog[open]") && !(event.key === "?" && at.sheet.open)) return;
    if (typing(event.target) && !(control && event.key === "s")) return;
    if ((event.altKey && !third) || operating(event)) return;
    let what = control ? CONTROL[event.key] || CONTROL[event.key.toLowerCase()] : KEYS[event.key] || KEYS[event.key.toLowerCase()];
    if (control && event.shiftKey && event.key.toLowerCase() === "z") what = ["redo"];
    const marked = getSelection(); // it is collapsed where it is in a box that was left
    if (control && event.key === "c" && !marked.isCollapsed && String(marked)) return; // text that is marked is copied as text
    let done = true;
    if (!control && event.key === "?") help();
    else if (!control && (event.key === "+" || event.key === "=")) zoomBy(1.5);
    else if (!control && event.key === "-") zoomBy(1 / 1.5);
    else if (!control && event.key === "0") { zoom = null; show(); }
    else if (what && what[0] === "save" && unsent()) setTimeout(() => send(...what), SENT);
    else if (what) send(...what);
    else done = false;
    if (done) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
  }

  function help() {
    if (at.sheet.open) at.sheet.close();
    else at.sheet.showModal();
  }

  // questions: the server's, and the first answer counts

  function ask({ id, title, text, yes }) {
    const button = (value, attributes) => make("button", { ...attributes, value });
    at.question.replaceChildren(make("form", { method: "dialog" }, make("h2", { text: title }), make("p", { text }),
      make("div", { class: "row" }, button("no", { text: "Cancel", autofocus: "" }), button("yes", { text: yes, class: "play" }))));
    at.question.returnValue = "no";
    if (!at.question.open) at.question.showModal();
    asked = id;
  }

  function answer(yes) {
    if (asked !== null) send("answer", { id: asked, yes });
    asked = null;
  }

  function showQuestion() {
    const { question } = state;
    if (question && question.id !== asked) ask(question);
    else if (!question && at.question.open) {
      asked = null;
      at.question.close();
    }
  }

  function helpSheet() {
    const parts = {
      "Play": [["Space", "play, pause, go on"], ["Esc", "stop, to the start"], [", .", "a control step back, ahead"], ["< >", "ten steps"], ["L", "loop"]],
      "Keyframes": [["A", "add: at the playhead, or after the selected one"], ["← →", "select the one before, after"], ["[ ]", "a step earlier, later"],
        ["Del", "delete"], ["Ctrl C X V", "copy, cut, paste"], ["Ctrl Z", "undo; with Shift: redo"], ["Ctrl S", "save"], ["Home End", "the start, the last one"]],
      "Pose": [["M", "mirror left and right"], ["T", "stand"], ["G", "lowest point on the floor"], ["P", "command the handle, or leave it to the policy"], ["W", "handle along the world or the limb"], ["F", "look at the pose"],
        ["H", "hide the robot while posing"], ["O", "poses before and after on, off"], ["?", "this sheet"]],
      "Mouse, in the timeline": [["click", "select a keyframe; elsewhere: move the playhead"], ["drag", "a keyframe to another time; its right edge to hold it"],
        ["double click", "add a keyframe there"], ["wheel", "zoom, as two fingers that part; with Shift, or sideways: move"], ["+ - 0", "zoom in, out, fit"]],
      "Mouse, in the scene": [["ball", "drag it; or click it for arrows and rings"], ["limb", "click it, then drag the ring of its joint"], ["drag", "turn the view; right button: move it"], ["wheel", "nearer, farther"]],
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
    return [make("h2", { text: "Keys and mouse" }), columns, make("button", { class: "corner", text: "×", "aria-label": "Close", onclick: () => help() })];
  }

  // what is shown

  function showNotes() {
    if (Math.max(0, ...state.notes.map((note) => note.id)) < lastNote) lastNote = 0; // a studio that was started again counts anew
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
    if (!timeline || !time || !state.file || !at.dock) return;
    window.platMoving = time.mode === "playing";
    count();
    if (window.platBlind) {
      cover("This browser cannot draw the scene.", window.platBlind);
      at.cover.classList.add("over");
      return;
    }
    if (!opened || at.cover.style.display !== "none") uncover();
    const pose = timeline.poses[timeline.selected], playing = time.mode === "playing", first = timeline.selected === 0;
    const label = playing ? "Pause" : time.mode === "paused" ? "Go on" : "Play";
    if (at.play.textContent !== label) at.play.replaceChildren(icon(playing ? "pause" : "play"), label);
    at.play.disabled = timeline.poses.length === 1;
    at.loop.classList.toggle("on", time.loop);
    if (document.activeElement !== at.speed) at.speed.value = time.speed;
    at.clock.replaceChildren(make("b", { text: time.cursor.toFixed(2) }), make("span", { text: ` / ${Math.max(timeline.duration, 0).toFixed(2)} s` }));
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
    if (!opened && window.platSoftware) softly();
    if (state.file.restorable) // when the page opens, and when it comes back
      showNote({ kind: "info", title: "Unsaved work", text: "Keyframes of an earlier session were not saved: Files, Restore autosave." });
    opened = true;
  }

  function softly() { // in place of a warning that would stay in front of the scene
    const warned = () => [...document.querySelectorAll(".mantine-Notification-root")].filter((box) => box.textContent.includes("Software WebGL"));
    new MutationObserver(() => warned().forEach((box) => { box.style.display = "none"; })).observe(document.body, { childList: true, subtree: true });
    warned().forEach((box) => { box.style.display = "none"; });
    showNote({ kind: "info", title: "Drawn in software", text: "This browser uses no GPU: no shadows, and fewer pixels while something moves." });
  }

  const spoken = (text) => text.replaceAll("_", " "); // joints as people say them

  function fill(input, value) {
    if (document.activeElement !== input && input.value !== value) input.value = value;
  }

  function showWords(pose) {
    at.words.replaceChildren();
    const calm = () => [spoken(state.check || ""), pose.speed > 0.05 && `fastest joint: ${spoken(pose.joint)}, ${pose.speed.toFixed(1)} rad/s`].filter(Boolean).join("  ·  ");
    const rest = pose.words.length ? make("span", { class: "bad", text: spoken(pose.words.join("; ")) }) : make("span", { text: calm() });
    if (pose.result) at.words.append(make("span", { class: pose.status === "reached" ? "good" : "bad", text: pose.result }), rest.textContent && "  ·  ");
    at.words.append(rest);
    at.words.title = at.words.textContent;
  }

  function mixed(share) { // green, amber, red
    return share > 1 ? "var(--red)" : share > 0.6 ? "var(--amber)" : "var(--calm)";
  }

  function showTrack(timeline, time) {
    framed = frame();
    const height = at.track.clientHeight || 90, axis = 30, middle = Math.round(axis + (height - axis) * 0.42), parts = [];
    const step = [0.02, 0.1, 0.2, 0.5, 1, 2, 5, 10].find((unit) => unit * framed.scale > 46) || 10;
    const begin = Math.max(Math.floor(framed.from / step), 0), count = Math.ceil(framed.width / framed.scale / step) + 1;
    parts.push(draw("rect", { x: 0, y: 0, width: framed.width, height: axis - 8, fill: "var(--ruler)" }));
    for (let number = begin; number < begin + count; number++) {
      const x = toX(number * step), label = draw("text", { x, y: 15, "text-anchor": "middle", class: "ruler" });
      label.textContent = `${+(number * step).toFixed(2)} s`;
      parts.push(draw("line", { x1: x, x2: x, y1: axis - 8, y2: height, stroke: "var(--grid)" }), label);
    }
    parts.push(...curves(height, axis));
    if (time.simulated > 0) parts.push(draw("rect", { x: toX(0), y: axis - 8, width: time.simulated * framed.scale, height: 3, fill: "var(--accent)", opacity: 0.5 }));
    let end = 0;
    timeline.poses.forEach((pose, number) => { // intervals, in the color of their fastest joint
      if (number > 0) {
        const line = draw("line", { x1: toX(end), x2: toX(pose.time), y1: middle, y2: middle, stroke: mixed(pose.words.length ? 2 : pose.share), "stroke-width": 5, "data-share": pose.share });
        if (pose.joint) line.append(tip(`${spoken(pose.joint)} at up to ${pose.speed.toFixed(1)} rad/s`));
        parts.push(line);
      }
      end = pose.time + pose.hold;
    });
    for (const mark of timeline.marks) parts.push(draw("circle", { cx: toX(mark), cy: middle, r: 3, fill: "var(--paper)", stroke: "var(--idle)" }));
    if (timeline.poses.length === 1) {
      const hint = draw("text", { x: toX(0) + 30, y: middle + 5, class: "hint" });
      hint.textContent = "No keyframes yet: press A, or double click here. Or choose a template beside Begin with.";
      parts.push(hint);
    }
    const now = toX(time.cursor), taken = [-Infinity, -Infinity]; // where the labels of the two rows end
    parts.push(draw("line", { x1: now, x2: now, y1: 10, y2: height, stroke: "var(--head)", "stroke-width": 2, "pointer-events": "none", "data-playhead": time.cursor }));
    const places = timeline.poses.map((pose) => toX(pose.time)), onTop = []; // the selected one is in front of all
    timeline.poses.forEach((pose, number) => {
      const x = places[number], chosen = number === timeline.selected, color = COLORS[pose.status], drawn = chosen ? onTop : parts;
      const room = Math.min(x - (places[number - 1] ?? -Infinity), (places[number + 1] ?? Infinity) - x); // many are small, and have no rims to hide each other
      const size = chosen ? 10 : Math.min(Math.max(room / 2, 4), 8), rim = chosen ? 3 : size < 7 ? 0 : 2;
      const told = [pose.label, `${pose.time.toFixed(2)} s`, pose.result, ...pose.words.map(spoken)].filter(Boolean);
      const group = draw("g", { class: chosen ? "key chosen" : "key", id: `key-${number}`, "data-key": number, role: "option", "data-status": pose.status, "aria-label": told.join(", "), "aria-selected": chosen });
      if (pose.hold > 0) group.append(draw("rect", { x, y: middle - 7, width: pose.hold * framed.scale, height: 14, rx: 4, fill: color, opacity: 0.4 }));
      group.append(draw("rect", { x: x - 12, y: axis - 4, width: 24, height: height - axis, fill: "transparent" }),
        draw("path", { d: `M${x} ${middle - size} l${size} ${size} l${-size} ${size} l${-size} ${-size}z`, fill: color, stroke: chosen ? "var(--accent)" : "var(--paper)", "stroke-width": rim }));
      if (pose.words.length) {
        const sign = draw("text", { x, y: middle - size - 3, "text-anchor": "middle", style: "fill:var(--red);font-weight:700" });
        sign.textContent = "▲!";
        group.append(sign);
      }
      const letters = [...pose.label], words = letters.length > 14 ? letters.slice(0, 13).join("") + "…" : pose.label, half = 3.2 * words.length + 4;
      const row = taken.findIndex((end) => x - half >= end);
      if (row >= 0 || chosen) { // a label that has no room is left out; the tip has it
        const text = draw("text", { x, y: middle + size + 14 + 13 * Math.max(row, 0), "text-anchor": "middle" });
        text.textContent = words;
        group.append(text);
        taken[Math.max(row, 0)] = x + half;
      }
      group.append(tip(told.join("\n")));
      drawn.push(group);
      if (number > 0) {
        const edge = x + Math.max(pose.hold * framed.scale, size + 2);
        if (chosen || pose.hold > 0)
          drawn.push(draw("g", { class: "edge", "data-edge": number }, draw("rect", { x: edge - 3, y: middle - 14, width: 18, height: 28, fill: "transparent" }),
            draw("rect", { x: edge - 1, y: middle - 10, width: 6, height: 20, rx: 3, fill: chosen ? "var(--accent)" : "var(--off)" }), tip("Drag to hold the pose")));
      }
    });
    parts.push(...onTop, draw("path", { d: `M${now - 6} 0 h12 v8 l-6 7 l-6 -7z`, fill: "var(--head)", "pointer-events": "none" }));
    at.track.replaceChildren(...parts);
    at.track.setAttribute("aria-activedescendant", `key-${timeline.selected}`); // the keyframes are drawn anew, the focus stays
  }

  function curves(height, axis) { // how far each robot was from its keyframe, at the foot of the track
    const { dt, of } = state.distances || { of: [] }, colors = ["var(--blue)", "var(--late)"];
    const most = Math.max(0.1, ...of.flat()), high = 0.5 * (height - axis);
    return of.flatMap((values, robot) => {
      if (values.filter((value) => value !== null).length < 2) return [];
      const spot = (value, step) => `${toX((step + 1) * dt).toFixed(1)},${(height - 2 - (high * value) / most).toFixed(1)}`;
      // null where a keyframe commands no place: the line has a gap there
      const path = values.map((value, step) => (value === null ? "" : `${(values[step - 1] ?? null) === null ? "M" : "L"}${spot(value, step)}`));
      const line = draw("path", { d: path.join(""), fill: "none", stroke: colors[robot], "stroke-width": 1.5, opacity: 0.75, "data-distance": robot });
      line.append(tip("mean distance of the commanded bodies from the keyframe"));
      const last = values[values.length - 1];
      if (last === null) return [line];
      const label = draw("text", { x: toX(values.length * dt) + 4, y: height - 2 - (high * last) / most, style: `fill:${colors[robot]}` });
      label.textContent = `${last.toFixed(2)} m`;
      return [line, label];
    });
  }

  function tip(text) {
    const title = draw("title");
    title.textContent = text;
    return title;
  }

  function count() { // how many frames a second this browser draws, while a robot plays; at rest it has nothing to do
    if (counting || !window.platMoving) return;
    counting = true;
    let frames = 0, since = performance.now();
    const frame = (now) => {
      counting = window.platMoving;
      if (!counting) return;
      frames += 1;
      if (now - since > 1000) {
        send("browser", { frames: (1000 * frames) / (now - since) });
        frames = 0;
        since = now;
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  build();
  connect();
})();
