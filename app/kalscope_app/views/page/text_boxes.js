// A text box that is not being edited shows the value of the server; see window.py, which defines `sizes` before
// this text.
//
// viser sends every key, through one throttle that all widgets share and that keeps only the newest message, and it
// writes every value of the server into the box, even while the user is typing there. Here a text is either being
// typed, and then it is not overwritten and nothing is sent, or it has been sent, and then the box shows the value of
// the server. The server answers every text that is sent, so the last message about a box contains its value.

const typingPause = 900; // ms without a key after which a complete number counts without Enter
const boxes = new Map(); // uuid -> what is known about a text box
const menus = new Map(); // uuid -> a menu that has a text box: its label, its options, and what was typed into it
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
    if (menus.has(target.id)) menus.get(target.id).typed = target.value;
    const box = boxOf(target);
    if (!box) return;
    if (box.before === null) box.before = box.served;
    box.typed = target.value;
    box.written.forEach((updates) => delete updates.value); // viser may not have drawn them yet
    box.written = [];
    clearTimeout(box.timer);
    if (number.test(box.typed)) box.timer = setTimeout(() => submit(box, box.typed), typingPause);
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

let isPressed = false; // a button of the mouse: a box that appears now would move what is pressed

// A menu takes only its options, and forgets any other text. Such a text goes into the text box of the menu.
const move = ({ target }, enter = false) => {
  const menu = menus.get(target.id);
  const text = menu?.typed.trim();
  const finds = (option) => option.toLowerCase().includes(text.toLowerCase()); // Enter takes what the menu has found
  if (!text || menu.options.includes(text) || (enter && menu.options.some(finds))) return;
  menu.typed = "";
  const [other, label] = sizes.textBoxes[menu.label];
  const box = [...boxes.values()].find((box) => box.label === label);
  const chosen = { type: "GuiUpdateMessage", uuid: target.id, updates: { value: other } };
  const act = () => {
    show([chosen]);
    send(chosen);
    write(box, text);
    submit(box, text);
    forget(box);
  };
  if (isPressed) addEventListener("pointerup", act, { capture: true, once: true });
  else act();
};

addEventListener("pointerdown", () => (isPressed = true), true);
addEventListener("pointerup", () => (isPressed = false), true);
addEventListener("focusout", move, true);
addEventListener("keydown", (event) => event.key === "Enter" && move(event, true), true);

const hold = (message) => {
  const { type, uuid, props, updates } = message;
  if (type === "GuiDropdownMessage" && sizes.textBoxes[props.label]) {
    menus.set(uuid, { label: props.label, options: props.options, typed: "" });
  } else if (type === "GuiUpdateMessage" && menus.has(uuid) && updates.options) {
    menus.get(uuid).options = updates.options;
  }
  if (type === "GuiTextMessage") {
    const { label } = props;
    const fresh = { uuid, label, served: message.value, before: null, typed: null, sent: false, timer: 0, written: [] };
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
      if (event.data?.type === "connected") {
        boxes.clear();
        menus.clear();
      } else if (event.data?.type === "message_batch") event.data.messages.forEach(hold);
      handler(event);
    };
  }

  postMessage(data, ...more) {
    const message = data?.type === "send" ? data.message : null;
    if (menus.has(message?.uuid)) menus.get(message.uuid).typed = ""; // an option was chosen
    if (message?.type === "GuiUpdateMessage" && boxes.has(message.uuid)) return; // a key: its text is sent above
    super.postMessage(data, ...more);
  }
};
