// Says in words that the program has ended, where viser only dims its widgets; see window.py.

const GONE = 3000; // ms without a connection; one that breaks for a moment is there again within a second or two
const bar = document.createElement("div");
bar.className = "kalscope-stopped";
bar.role = "alert";
bar.textContent = /^(localhost|127\.|\[::1)/.test(location.hostname)
  ? "Kalscope has stopped: start it again."
  : "Kalscope cannot be reached: it has stopped, or the network is down.";
let timer = null;

window.Worker = class extends Worker {
  set onmessage(handler) {
    super.onmessage = (event) => {
      if (event.data?.type === "closed") {
        timer ??= setTimeout(() => document.body.append(bar), GONE);
      } else if (event.data?.type === "connected") {
        clearTimeout(timer);
        timer = null;
        bar.remove();
      }
      handler(event);
    };
  }
};
