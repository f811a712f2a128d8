"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const cells = (name, row) => {
    const line = document.createElement("tr");
    for (const text of row) {
      line.append(Object.assign(document.createElement(name), { textContent: text }));
    }
    return line;
  };
  const items = (id, texts) => at(id).replaceChildren(
    ...texts.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  let shown = null;
  const report = (of) => {
    if (of === null || of === shown) { return; }
    shown = of;
    at("report").hidden = false;
    at("report").src = `/report?until=${of}`;
  };
  const source = new EventSource("/events");
  source.onmessage = (event) => {
    const state = JSON.parse(event.data);
    at("link").textContent = `as of ${new Date().toLocaleTimeString()}`;
    items("faults", state.faults);
    items("advice", state.advice);
    at("rows").replaceChildren(...state.rows.map((row) => cells("td", row)));
    at("head").replaceChildren(cells("th", state.head));
    at("gyros").replaceChildren(...state.gyros.map((row) => cells("td", row)));
    report(state.report);
  };
  source.onerror = () => { at("link").textContent = "no answer: the session has ended"; };
})();
