// Keeps the page up with a live board, however slow the browser is; see window.py.
//
// viser applies every message of the server, in turn, and a board brings 22 charts a second. A page that draws fewer
// would fall further and further behind, and a click would wait for all earlier messages. So what arrives while the
// page draws waits here, and of the messages that set the same properties of a widget only the last one is kept.
// viser's server chooses by the same rule what it sends to a browser that connects late or reads slowly. After a
// picture that took LONG to draw the page pauses, so that clicks and keys are handled.

const waiting = new Map(); // what the message sets -> the message
const drawn = new MessageChannel();
const LONG = 500; // ms
const PAUSE = 200; // ms
let isDrawing = false;
let begun = 0;
let apply = () => {};

const whatItSets = ({ type, uuid, updates }) => {
  if (type === "GuiUpdateMessage") return `${uuid} ${Object.keys(updates).sort()}`;
  return type === "BackgroundImageMessage" ? type : Symbol("kept in any case");
};

const keep = (message) => {
  const key = whatItSets(message);
  waiting.delete(key); // the later message goes to the end, not to the place of the earlier one
  waiting.set(key, message);
};

const tellWhenDrawn = () => {
  const tell = () => drawn.port2.postMessage(null);
  if (document.hidden) tell(); // where nothing is drawn
  else requestAnimationFrame(tell);
};

const applyWaiting = () => {
  isDrawing = waiting.size > 0;
  if (!isDrawing) return;
  const messages = [...waiting.values()];
  waiting.clear();
  begun = performance.now();
  tellWhenDrawn();
  apply({ data: { type: "message_batch", messages } });
};

drawn.port1.onmessage = () => {
  const took = performance.now() - begun;
  if (took > LONG) setTimeout(applyWaiting, PAUSE);
  else applyWaiting();
};
addEventListener("visibilitychange", () => isDrawing && tellWhenDrawn());

window.Worker = class extends Worker {
  set onmessage(handler) {
    apply = handler;
    super.onmessage = (event) => {
      if (event.data?.type === "message_batch") {
        event.data.messages.forEach(keep);
        if (!isDrawing) applyWaiting();
      } else {
        applyWaiting(); // what was sent before a connection ended belongs before it
        handler(event);
      }
    };
  }
};
