/* Before the scene is made: whether this browser draws in software. If it does, the scene gets a third of the pixels,
   unless the address says otherwise (?fixedDpr=1), and the server leaves out the shadows. */
(() => {
  "use strict";
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? probe.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  if (probe) probe.getExtension("WEBGL_lose_context")?.loseContext();
  window.platSoftware = /swiftshader|llvmpipe|software|basic render/i.test(renderer);
  const address = new URL(location.href);
  if (!window.platSoftware || address.searchParams.has("fixedDpr")) return;
  address.searchParams.set("fixedDpr", "0.6");
  history.replaceState(null, "", address);
})();
