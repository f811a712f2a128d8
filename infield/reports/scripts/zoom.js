// Figures that a reader can zoom. Each figure.zoom holds a drawing, which stays where there is no JavaScript and on paper, and
// the numbers behind it as JSON. A drag across a drawing zooms all drawings of its group to that stretch; a double click shows
// all. A drawing in a closed <details> is made when that is opened.
(function () {
  "use strict";
  var figures = document.querySelectorAll("figure.zoom");
  if (!figures.length || typeof uPlot !== "function") return;
  document.documentElement.classList.add("zooms"); // what says how to zoom is shown
  var groups = {};
  var style = getComputedStyle(document.documentElement);
  var INKS = { "#000000": "--ink", "#D55E00": "--old", "#0072B2": "--new", "#59636E": "--soft" };
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var STRIP = 8; // pixels: a phase along the top
  var LEAST = 4; // pixels of a drag: less is a click

  function colour(name) { return style.getPropertyValue(name).trim() || "#59636e"; }

  // the colour of a moment: a system that turns dark changes it
  function now(name) { return function () { return colour(name); }; }

  function inkOf(curve) { return INKS[curve.colour] ? colour(INKS[curve.colour]) : curve.colour; }

  function setRange(charts, low, high) { charts.forEach(function (chart) { chart.setScale("x", { min: low, max: high }); }); }

  function showAll(charts) { charts.forEach(function (chart) { setRange([chart], chart.all[0], chart.all[1]); }); }

  // what the first of some drawings shows, moved and stretched, and never beyond all that they hold
  function move(charts, first, about, by) {
    var x = first.scales.x, span = (x.max - x.min) * about, low = (x.max + x.min) / 2 + by * (x.max - x.min) - span / 2;
    var least = Math.min.apply(null, charts.map(function (chart) { return chart.all[0]; }));
    var most = Math.max.apply(null, charts.map(function (chart) { return chart.all[1]; }));
    span = Math.min(span, most - least);
    low = Math.min(Math.max(low, least), most - span);
    setRange(charts, low, low + span);
  }

  // A drag of mouse or finger across a drawing: what lies between its ends is shown by all drawings of the group, wherever the
  // button is let go (uPlot itself takes the edge for an end as soon as a drag leaves the field, below it as well).
  function dragged(chart, charts, down) {
    var from = down.clientX, field = chart.over;

    function value(x) {
      var box = field.getBoundingClientRect();
      return chart.posToVal(Math.min(Math.max(x - box.left, 0), box.width), "x");
    }

    function stretch(event) { return [value(Math.min(from, event.clientX)), value(Math.max(from, event.clientX))]; }

    function marks(ends) {
      charts.forEach(function (one) {
        var left = Math.max(one.valToPos(ends[0], "x"), 0), right = Math.min(one.valToPos(ends[1], "x"), one.over.clientWidth);
        one.setSelect({ left: left, top: 0, width: Math.max(right - left, 0), height: one.over.clientHeight }, false);
      });
    }

    function moved(event) { marks(stretch(event)); }

    function over(event) {
      ["pointermove", "pointerup", "pointercancel"].forEach(function (kind, k) { document.removeEventListener(kind, k ? over : moved); });
      setTimeout(function () { // what uPlot does of the same event comes first
        charts.forEach(function (one) { one.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false); });
        if (event.type !== "pointerup" || Math.abs(event.clientX - from) < LEAST) return;
        var ends = stretch(event);
        setRange(charts, ends[0], ends[1]);
      }, 0);
    }

    document.addEventListener("pointermove", moved);
    document.addEventListener("pointerup", over);
    document.addEventListener("pointercancel", over);
  }

  function inked(chart, told) { // letters, lines and their names in the colours of the moment
    var rows = chart.root.querySelectorAll(".u-legend .u-series");
    told.curves.forEach(function (curve) {
      var marker = rows[curve.at] && rows[curve.at].querySelector(".u-marker");
      if (marker && !curve.mark) marker.style.borderColor = inkOf(curve);
    });
    chart.redraw(true, true);
  }

  function edges(chart, from, to) {
    var left = chart.valToPos(Math.max(from, chart.scales.x.min), "x", true);
    return [left, chart.valToPos(Math.min(to, chart.scales.x.max), "x", true) - left];
  }

  function shaded(told) {
    return function (chart) {
      var ctx = chart.ctx;
      ctx.save();
      ctx.fillStyle = colour("--shade");
      told.spans.forEach(function (span) {
        var at = edges(chart, span.start, span.end);
        if (at[1] > 0) ctx.fillRect(at[0], chart.bbox.top, at[1], chart.bbox.height);
      });
      told.strips.forEach(function (strip) {
        var at = edges(chart, strip.start, strip.end);
        ctx.fillStyle = strip.colour;
        if (at[1] > 0) ctx.fillRect(at[0], chart.bbox.top, at[1], STRIP * devicePixelRatio);
      });
      ctx.restore();
    };
  }

  var SHAPES = {
    "^": [[0, -1], [1, 0.8], [-1, 0.8]], "v": [[0, 1], [1, -0.8], [-1, -0.8]],
    "s": [[-1, -1], [1, -1], [1, 1], [-1, 1]], "n": [[-0.6, -0.6], [0.6, -0.6], [0.6, 0.6], [-0.6, 0.6]]
  };

  function shape(ctx, mark, x, y, size) {
    ctx.beginPath();
    if (mark === "x") {
      ctx.moveTo(x - size, y - size); ctx.lineTo(x + size, y + size); ctx.moveTo(x - size, y + size); ctx.lineTo(x + size, y - size);
      ctx.stroke();
    } else if (SHAPES[mark]) {
      SHAPES[mark].forEach(function (p) { ctx.lineTo(x + p[0] * size, y + p[1] * size); });
      ctx.fill();
    } else {
      ctx.arc(x, y, size * 0.9, 0, 2 * Math.PI);
      if (mark === "O") ctx.stroke(); else ctx.fill();
    }
  }

  function marked(told) {
    return function (chart) {
      var ctx = chart.ctx, box = chart.bbox, pixel = devicePixelRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(box.left, box.top, box.width, box.height);
      ctx.clip();
      told.curves.forEach(function (curve) {
        if (!curve.mark || !chart.series[curve.at].show) return;
        ctx.strokeStyle = ctx.fillStyle = inkOf(curve);
        (curve.x || told.x).forEach(function (value, k) {
          if (curve.values[k] === null) return;
          var x = chart.valToPos(value, "x", true), y = chart.valToPos(curve.values[k], "y", true);
          ctx.lineWidth = (curve.mark === "|" ? 4 : 1) * pixel;
          ctx.globalAlpha = curve.mark === "|" ? 0.55 : 1;
          if (curve.low) {
            ctx.beginPath();
            ctx.moveTo(x, chart.valToPos(curve.low[k], "y", true));
            ctx.lineTo(x, chart.valToPos(curve.high[k], "y", true));
            ctx.stroke();
          }
          ctx.lineWidth = 1.4 * pixel;
          if (curve.mark !== "|") shape(ctx, curve.mark, x, y, (curve.mark === "." ? 1.5 : 3.6) * pixel);
        });
      });
      ctx.restore();
    };
  }

  function digits(value) { return value === null || value === undefined ? "" : String(Number(value.toPrecision(6))); }

  function plain(value) { return String(Number(value.toPrecision(10))); }

  function turned(value) { return value === null || value === undefined ? "" : plain(((value % 360) + 360) % 360); }

  // columns on one x axis: [data, first column of each curve]
  function columns(told) {
    var shared = [told.x], own = [], at = 1;
    var order = told.curves.filter(function (c) { return !c.x; }).concat(told.curves.filter(function (c) { return c.x; }));
    order.forEach(function (curve) {
      var table = curve.x ? [curve.x] : shared;
      table.push(curve.values);
      curve.at = at++;
      if (curve.low) { table.push(curve.high, curve.low); at += 2; }
      if (curve.x) own.push(table);
    });
    told.curves = order;
    var tables = shared.length > 1 ? [shared].concat(own) : own;
    return tables.length > 1 ? uPlot.join(tables) : tables[0];
  }

  // 1, 2 or 5 times a power of ten, below or above a positive number
  function round(value, up) {
    var decade = Math.pow(10, Math.floor(Math.log10(value))), steps = [1, 2, 5, 10];
    var fits = steps.filter(function (step) { return up ? step * decade >= value : step * decade <= value; });
    return Number((decade * (up ? fits[0] : fits[fits.length - 1])).toPrecision(6));
  }

  function within(limits, strips, log) {
    return function (chart, low, high) {
      if (log) {
        if (!(low > 0)) return [0.1, 1];
        return [round(low * 1.000001, false), round(high * 0.999999, true)];
      }
      if (low === null || low === high) return limits || [(low || 0) - 1, (high || 0) + 1];
      var pad = 0.06 * (high - low), top = strips.length ? 2.5 * pad : pad; // a strip hides nothing
      return limits ? [Math.max(low - pad, limits[0]), Math.min(high + top, limits[1])] : [low - pad, high + top];
    };
  }

  function chartOf(told, place, height) {
    var data = columns(told);
    var series = [{ label: told.x_name, value: function (u, v) { return v === null ? "" : v.toFixed(1); } }];
    var bands = [];
    var shown = told.circle ? turned : digits;
    told.curves.forEach(function (curve) {
      series.push({ label: curve.name || "-", class: curve.name ? "named" : "edge", stroke: function () { return inkOf(curve); }, width: curve.mark ? 0 : 1.4,
        dash: curve.dashed ? [6, 4] : undefined, paths: curve.mark ? function () { return null; } : undefined,
        points: { show: false }, value: function (u, v) { return shown(v); } });
      if (!curve.low) return;
      ["high", "low"].forEach(function (edge) {
        series.push({ label: edge, class: "edge", stroke: "transparent", width: 0, points: { show: false },
          paths: curve.mark ? function () { return null; } : undefined, value: function () { return ""; } });
      });
      if (!curve.mark) bands.push({ series: [series.length - 2, series.length - 1], fill: function () { return inkOf(curve) + "33"; } });
    });
    var ticks = { stroke: now("--ink"), grid: { stroke: now("--line"), width: 1 }, ticks: { stroke: now("--line"), width: 1 },
      font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    var key = told.x_name + " " + told.group;
    var charts = groups[key] = groups[key] || [];
    var chart = new uPlot({
      title: told.title || undefined, width: place.clientWidth, height: height, series: series, bands: bands,
      scales: { x: { time: false }, y: { distr: told.log ? 3 : 1, range: within(told.limits, told.strips, told.log) } },
      cursor: { sync: { key: key }, drag: { x: true, y: false, setScale: false } },
      axes: [Object.assign({ label: told.x_name, labelSize: 20, size: 34, values: function (u, at) { return at.map(plain); } }, ticks),
        Object.assign({ label: told.unit, labelSize: 20, size: 62 }, told.circle ? { incrs: [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 15, 30, 45, 90, 180, 360, 720, 1440], values: function (u, at, axis, space, step) { return at.map(step < 360 ? turned : plain); } }
          : told.log ? { values: function (u, at) { return at.map(function (v) { return v === null ? null : plain(v); }); } } : {}, ticks)],
      hooks: { drawClear: [shaded(told)], draw: [marked(told)],
        ready: [function (made) { made.all = [made.scales.x.min, made.scales.x.max]; }] }
    }, data, place);
    chart.over.addEventListener("pointerdown", function (event) {
      if (event.isPrimary && event.button === 0) dragged(chart, charts, event);
    });
    place.addEventListener("dblclick", function () { showAll(charts); });
    if (dark.addEventListener) dark.addEventListener("change", function () { inked(chart, told); });
    window.addEventListener("resize", function () { if (place.clientWidth) chart.setSize({ width: place.clientWidth, height: height }); });
    charts.push(chart);
    return charts;
  }

  function buttons(charts, first, x_name) {
    var sides = /^time\b|^year\b/.test(x_name) ? ["earlier", "later"] : ["lower", "higher"];
    var row = document.createElement("p");
    row.className = "zoomer";
    function add(text, act) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      button.addEventListener("click", act);
      row.appendChild(button);
    }
    [[sides[0], 1, -0.5], [sides[1], 1, 0.5], ["closer", 0.5, 0], ["wider", 2, 0]].forEach(function (one) {
      add(one[0], function () { move(charts, first, one[1], one[2]); });
    });
    add("all", function () { showAll(charts); });
    return row;
  }

  function stripKey(strips) {
    var list = document.createElement("ul"), seen = {};
    list.className = "key chart-key";
    strips.forEach(function (strip) {
      if (seen[strip.name]) return;
      seen[strip.name] = true;
      var item = document.createElement("li"), swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = strip.colour;
      item.append(swatch, strip.name);
      list.appendChild(item);
    });
    return list;
  }

  function live(figure) {
    var first = figure.firstChild, charts, strips = [], told;
    figure.querySelectorAll("script").forEach(function (script) {
      told = JSON.parse(script.textContent);
      var place = document.createElement("div");
      place.className = "chart";
      figure.insertBefore(place, first);
      charts = chartOf(told, place, told.strips.length ? 200 : 260);
      strips = strips.concat(told.strips);
    });
    if (!charts) return;
    if (strips.length) figure.insertBefore(stripKey(strips), figure.firstChild);
    figure.classList.add("live");
    var panels = figure.closest(".panels");
    var shown = charts[charts.length - 1];
    if (!panels) figure.insertBefore(buttons(charts, shown, told.x_name), first);
    else if (!panels.dataset.live) {
      panels.dataset.live = "yes";
      panels.after(buttons(charts, shown, told.x_name));
    }
  }

  function whenSeen(figure) {
    var closed = figure.closest("details:not([open])");
    if (!closed) { live(figure); return; }
    closed.addEventListener("toggle", function () { whenSeen(figure); }, { once: true });
  }

  Array.prototype.forEach.call(figures, whenSeen);
})();
