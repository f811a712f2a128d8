"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const signs = (text) => text.replaceAll(" +- ", " \u00b1 ").replaceAll(" -> ", " \u2192 ");
  const cell = (name, className, text) =>
    Object.assign(document.createElement(name), { className, textContent: signs(text) });
  const line = (name, className, [first, ...others]) => {
    const row = document.createElement("tr");
    row.append(cell("th", "name", first), ...others.map((text) => cell(name, className, text)));
    return row;
  };
  const items = (id, texts) => at(id).replaceChildren(...texts.map((text) => cell("li", "", text)));
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
    at("rows").replaceChildren(...state.rows.map((row) => line("td", "", row)));
    at("head").replaceChildren(line("th", "n", state.head));
    at("gyros").replaceChildren(...state.gyros.map((row) => line("td", "n", row)));
    report(state.report);
  };
  source.onerror = () => { at("link").textContent = "no answer: the session has ended"; };
})();
