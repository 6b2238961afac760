// A text box that is not being edited shows the value of the server; see page_script.py, which defines `sizes` before
// this text.
//
// viser sends every key, through one throttle that all widgets share and that keeps only the newest message, and it
// writes every value of the server into the box, even while the user is typing there. Here a text is either being
// typed, and then it is not overwritten and nothing is sent, or it has been sent, and then the box shows the value of
// the server. The server answers every text that is sent, so the last message about a box contains its value.

const boxes = new Map(); // uuid -> what is known about a text box
const number = /^\s*[-+−]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?\s*$/i;
let show = () => {}; // passes messages to viser, as if the server had sent them
let send = () => {};

const boxOf = (input) => {
  for (let part = input.parentElement; part; part = part.parentElement) {
    const label = part.querySelector("label[for]");
    if (label) return boxes.get(label.htmlFor);
  }
};

const write = (box, value) => show([{ type: "GuiUpdateMessage", uuid: box.uuid, updates: { value } }]);

const submit = (box, text) => {
  clearTimeout(box.timer);
  box.typed = null;
  box.sent = true;
  box.served = text; // until the server answers: the user may type the previous text again
  send({ type: "GuiUpdateMessage", uuid: box.uuid, updates: { value: text } });
};

// Sends the text, unless it is unchanged: then the box shows the present value of the server.
const leave = (box) => {
  if (box.typed === null) return;
  const text = box.typed;
  if (text !== box.before || box.sent) return submit(box, text);
  clearTimeout(box.timer);
  box.typed = null;
  write(box, box.served);
};

const restore = (box) => {
  const before = box.before;
  clearTimeout(box.timer);
  box.typed = null;
  if (box.sent) submit(box, before);
  write(box, box.sent ? before : box.served);
};

const forget = (box) => Object.assign(box, { before: null, sent: false });

addEventListener(
  "input",
  ({ target }) => {
    const box = boxOf(target);
    if (!box) return;
    if (box.before === null) box.before = box.served;
    box.typed = target.value;
    box.written.forEach((updates) => delete updates.value); // viser may not have drawn them yet
    box.written = [];
    clearTimeout(box.timer);
    if (number.test(box.typed)) box.timer = setTimeout(() => submit(box, box.typed), sizes.typingPause);
  },
  true,
);

addEventListener(
  "keydown",
  (event) => {
    const enter = event.key === "Enter" && event.target.tagName === "INPUT";
    if (!(enter || event.key === "Escape") || event.isComposing) return;
    const box = boxOf(event.target);
    if (!box || box.before === null) return;
    if (enter) leave(box);
    else restore(box);
    forget(box);
  },
  true,
);

addEventListener(
  "focusout",
  ({ target }) => {
    const box = boxOf(target);
    if (!box || document.activeElement === target) return; // only the window was left
    leave(box);
    forget(box);
  },
  true,
);

const hold = (message) => {
  const { type, uuid, updates } = message;
  if (type === "GuiTextMessage") {
    const fresh = { uuid, served: message.value, before: null, typed: null, sent: false, timer: 0, written: [] };
    boxes.set(uuid, fresh);
  } else if (type === "GuiRemoveMessage") {
    boxes.delete(uuid);
  } else if (type === "GuiUpdateMessage" && boxes.has(uuid) && typeof updates.value === "string") {
    const box = boxes.get(uuid);
    box.served = updates.value;
    if (box.typed !== null) delete updates.value;
    else box.written = [...box.written.slice(-9), updates];
  }
};

window.Worker = class extends Worker {
  set onmessage(handler) {
    send = (message) => super.postMessage({ type: "send", message });
    super.onmessage = (event) => {
      show = (messages) => handler({ data: { type: "message_batch", messages } });
      if (event.data?.type === "connected") boxes.clear();
      else if (event.data?.type === "message_batch") event.data.messages.forEach(hold);
      handler(event);
    };
  }

  postMessage(data, ...more) {
    const message = data?.type === "send" ? data.message : null;
    if (message?.type === "GuiUpdateMessage" && boxes.has(message.uuid)) return; // a key: its text is sent above
    super.postMessage(data, ...more);
  }
};
