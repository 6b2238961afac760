// Replaces viser's 3-D scene, so that no browser needs WebGL; see window.py, which defines `sizes` before this
// text.
//
// viser applies the server's messages in a part of its scene, and three.js builds no scene where `getContext` gives
// null: such a browser would show no widget at all. Kalscope has nothing in the scene. So three.js gets a context here
// that draws nothing, in every browser, and all show the same page; none waits for shaders or for a slow graphics card.
// The scene is moved off the screen, where viser renders no frame of it. The one picture that the server sends to it,
// the signal on a phone, is shown as a plain image.

const ANSWERS = {
  getContextAttributes: () => ({}),
  getExtension: (name) => (name === "EXT_color_buffer_float" ? {} : null), // without it three.js logs an error
  getParameter: (name) => ({ VERSION: "WebGL 2.0", VIEWPORT: [0, 0, 0, 0], SCISSOR_BOX: [0, 0, 0, 0] })[name] ?? 16,
  getShaderPrecisionFormat: () => ({ precision: 23 }),
  getProgramParameter: (_program, name) => (name === "LINK_STATUS" ? true : 0), // no uniforms, no attributes
  getProgramInfoLog: () => "",
  getShaderInfoLog: () => "",
};

// A constant is its own name, and any other call returns a new object: a buffer, a texture, a program.
const drawsNothing = new Proxy(ANSWERS, {
  get(answers, name) {
    if (typeof name === "symbol") return undefined;
    return /^[A-Z]/.test(name) ? name : (answers[name] ?? (() => ({})));
  },
});

const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
  return kind === "webgl2" ? drawsNothing : getContext.call(this, kind, ...options);
};

const rules = document.head.appendChild(document.createElement("style"));
rules.textContent = `
${sizes.scene} { transform: translateX(-300vw); }
.kalscope-phone { position: absolute; inset: 0; width: 100%; height: 100%; }
@media not all and ${sizes.phoneWidth} { .kalscope-phone { display: none; } }`;

const signal = new Image();
signal.className = "kalscope-phone";
signal.alt = "The signal: raw and filtered";

const show = ({ format, rgb_data: data }) => {
  URL.revokeObjectURL(signal.src);
  if (!data?.byteLength) return signal.remove(); // none yet, and no broken picture in its place
  signal.src = URL.createObjectURL(new Blob([data], { type: `image/${format}` }));
  if (!signal.isConnected) document.querySelector(sizes.scene)?.after(signal);
};

window.Worker = class extends Worker {
  set onmessage(handler) {
    super.onmessage = (event) => {
      if (event.data?.type === "message_batch") {
        const { messages } = event.data;
        messages.filter((message) => message.type === "BackgroundImageMessage").forEach(show);
        event.data.messages = messages.filter((message) => message.type !== "BackgroundImageMessage");
      }
      handler(event);
    };
  }
};
