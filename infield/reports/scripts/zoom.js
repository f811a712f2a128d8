// Time series that a reader can zoom. Each figure.zoom holds a drawing, which stays where there is no JavaScript, and the
// numbers behind it as JSON. A drag across the drawing zooms all drawings of the page to that time; a double click shows all.
(function () {
  "use strict";
  var figures = document.querySelectorAll("figure.zoom");
  if (!figures.length || typeof uPlot !== "function") return;
  var charts = [];
  var style = getComputedStyle(document.documentElement);

  function colour(name) { return style.getPropertyValue(name).trim() || "#59636e"; }

  function setTime(low, high) { charts.forEach(function (chart) { chart.setScale("x", { min: low, max: high }); }); }

  function showAll() { charts.forEach(function (chart) { setRange(chart, chart.all[0], chart.all[1]); }); }

  function setRange(chart, low, high) { chart.setScale("x", { min: low, max: high }); }

  function move(chart, about, by) {
    var x = chart.scales.x, span = x.max - x.min, middle = (x.max + x.min) / 2 + by * span;
    setTime(middle - span * about / 2, middle + span * about / 2);
  }

  function shaded(spans) {
    return function (chart) {
      chart.ctx.save();
      chart.ctx.fillStyle = colour("--shade");
      spans.forEach(function (span) {
        var left = chart.valToPos(Math.max(span.start, chart.scales.x.min), "x", true);
        var right = chart.valToPos(Math.min(span.end, chart.scales.x.max), "x", true);
        if (right > left) chart.ctx.fillRect(left, chart.bbox.top, right - left, chart.bbox.height);
      });
      chart.ctx.restore();
    };
  }

  function digits(value) { return value === null || value === undefined ? "" : String(Number(value.toPrecision(6))); }

  function plain(value) { return String(Number(value.toPrecision(10))); }

  function drawn(figure) {
    var told = JSON.parse(figure.querySelector("script").textContent);
    var data = [told.x], series = [{ label: told.x_name, value: function (u, v) { return v === null ? "" : v.toFixed(1); } }];
    var bands = [];
    told.curves.forEach(function (curve) {
      var ink = curve.colour === "#000000" ? colour("--ink") : curve.colour;
      series.push({ label: curve.name, stroke: ink, width: 1.4, points: { show: false },
        value: function (u, v) { return digits(v); } });
      data.push(curve.values);
      if (!curve.low) return;
      ["high", "low"].forEach(function (edge) {
        series.push({ label: edge, class: "edge", stroke: "transparent", width: 0, points: { show: false }, value: function () { return ""; } });
        data.push(curve[edge]);
      });
      bands.push({ series: [series.length - 2, series.length - 1], fill: ink + "33" });
    });
    var place = document.createElement("div");
    place.className = "chart";
    figure.insertBefore(place, figure.firstChild);
    var ticks = { stroke: colour("--ink"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1 },
      font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    var chart = new uPlot({
      width: place.clientWidth, height: 260, series: series, bands: bands, scales: { x: { time: false } },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false } },
      axes: [Object.assign({ label: told.x_name, labelSize: 20, values: function (u, at) { return at.map(plain); } }, ticks), Object.assign({ label: told.unit, labelSize: 20, size: 62 }, ticks)],
      hooks: { drawClear: [shaded(told.spans)] }
    }, data, place);
    chart.all = [told.x[0], told.x[told.x.length - 1]];
    place.addEventListener("dblclick", showAll);
    place.addEventListener("mouseup", function () {
      setTimeout(function () { setTime(chart.scales.x.min, chart.scales.x.max); }, 0);
    });
    var row = document.createElement("p");
    row.className = "zoomer";
    [["earlier", 1, -0.5], ["later", 1, 0.5], ["closer", 0.5, 0], ["wider", 2, 0]].forEach(function (one) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = one[0];
      button.addEventListener("click", function () { move(chart, one[1], one[2]); });
      row.appendChild(button);
    });
    var all = document.createElement("button");
    all.type = "button";
    all.textContent = "all";
    all.addEventListener("click", showAll);
    row.appendChild(all);
    place.appendChild(row);
    figure.classList.add("live");
    charts.push(chart);
    return { chart: chart, place: place };
  }

  var live = Array.prototype.map.call(figures, drawn);
  window.addEventListener("resize", function () {
    live.forEach(function (one) { one.chart.setSize({ width: one.place.clientWidth, height: 260 }); });
  });
})();
