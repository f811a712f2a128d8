// Shows the figures of a page: each figure.plot holds a place and a specification in JSON, which plotly draws when the place
// comes into view. Figures of one group zoom along x together. The dark takes the inks of the style sheet; paper is always light.
(function () {
  "use strict";
  var dark = matchMedia("(prefers-color-scheme: dark)"), onPaper = matchMedia("print");
  var INKS = { "#000000": "--ink", "#d55e00": "--old", "#0072b2": "--new", "#56b4e9": "--sky", "#59636e": "--soft", "#c9d1d9": "--pale",
    "#ffffff": "--page", "#e3e8ed": "--shade" };
  var PAPER_PX = { wide: 680, panel: 330, card: 300 }, PAPER_SHARE = 0.8; // A4 less its margins, parts of it; of a panel's height
  var PNG_PX = [720, 420]; // at least
  var shown = [], busy = false, printing = false;

  function inked(text) {
    if (printing || !dark.matches) return text;
    var style = getComputedStyle(document.documentElement);
    return text.replace(/"(#[0-9a-f]{6})([0-9a-f]{2})?"/gi, function (all, colour, clear) {
      var name = INKS[colour.toLowerCase()], value = name && style.getPropertyValue(name).trim();
      return value && value.length === 7 ? '"' + value + (clear || "") + '"' : all;
    });
  }

  function told(figure) {
    var found = JSON.parse(inked(figure.querySelector("script").textContent));
    var wide = figure.classList.contains("wide"), card = figure.closest(".card");
    if (printing) found.layout.width = PAPER_PX[card ? "card" : wide ? "wide" : "panel"];
    if (printing && !wide) found.layout.height *= PAPER_SHARE;
    if (matchMedia("(pointer: coarse)").matches) found.layout.dragmode = false; // a finger moves the page
    return found;
  }

  // with the key, which stands beside the figure on the page
  function png(place) {
    var key = { showlegend: true, legend: { orientation: "h", y: -0.25 } };
    Plotly.downloadImage({ data: place.data, layout: Object.assign({}, place.layout, key) },
      { format: "png", scale: 2, width: Math.max(place.clientWidth, PNG_PX[0]), height: Math.max(place.clientHeight, PNG_PX[1]),
        filename: place.getAttribute("aria-label") });
  }

  var CONFIG = { responsive: true, displaylogo: false, modeBarButtons: [
    ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"],
    [{ name: "save", title: "Save as PNG", icon: Plotly.Icons.camera, click: png }]] };

  function draw(figure) {
    var place = figure.querySelector(".drawing"), found = told(figure);
    if (!shown.includes(figure)) {
      shown.push(figure);
      place.style.minHeight = "";
      place.style.minWidth = Math.min(figure.dataset.least, 640) + "px";
      Plotly.newPlot(place, found.data, found.layout, CONFIG);
      place.on("plotly_relayout", function (change) { follow(figure, change); });
    } else Plotly.react(place, found.data, found.layout, CONFIG);
    if (hiddenBy(figure).length) hide(figure);
  }

  // what was done along x in one figure, in the others of its group
  function follow(figure, change) {
    var ends = {};
    Object.keys(change).forEach(function (key) { if (/^xaxis\.(range|autorange)/.test(key)) ends[key] = change[key]; });
    if (busy || !figure.dataset.group || !Object.keys(ends).length) return;
    busy = true;
    var others = shown.filter(function (one) { return one !== figure && one.dataset.group === figure.dataset.group; });
    Promise.all(others.map(function (one) { return Plotly.relayout(one.querySelector(".drawing"), ends); }))
      .finally(function () { busy = false; });
  }

  // a press of a name in the key hides or shows what it names
  function hiddenBy(figure) {
    return Array.from(figure.closest(".plots").querySelectorAll(".key [aria-pressed=false]"), function (b) { return b.dataset.name; });
  }

  function hide(figure) {
    var place = figure.querySelector(".drawing"), hidden = hiddenBy(figure);
    Plotly.restyle(place, { visible: place.data.map(function (trace) { return !hidden.includes(trace.meta); }) });
  }

  document.addEventListener("click", function (event) {
    var button = event.target.closest(".key button");
    if (!button) return;
    button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") === "false");
    shown.filter(function (one) { return button.closest(".plots").contains(one); }).forEach(hide);
  });

  var figures = Array.from(document.querySelectorAll("figure.plot"));
  figures.forEach(function (figure) { // the page keeps its length when they are drawn
    var height = /"height":(\d+)/.exec(figure.querySelector("script").textContent);
    figure.querySelector(".drawing").style.minHeight = height[1] + "px";
  });
  var watch = new IntersectionObserver(function (entries) {
    entries.forEach(function (entry) {
      if (!entry.isIntersecting) return;
      watch.unobserve(entry.target);
      draw(entry.target);
    });
  }, { rootMargin: "300px" });
  figures.forEach(function (figure) { watch.observe(figure); });

  function again() { shown.forEach(draw); }

  function print(now) {
    if (printing === now) return;
    printing = now;
    if (now) figures.forEach(draw); else again();
  }

  dark.addEventListener("change", again);
  onPaper.addEventListener("change", function () { print(onPaper.matches); });
  addEventListener("beforeprint", function () { print(true); });
  addEventListener("afterprint", function () { print(false); });
})();
