// Draws each figure of the page from the data beside its image. uPlot has the axes, the crosshair and the rectangle that
// zooms; curves, loops among them, are drawn here in the styles of the image.
"use strict";
(() => {
  const text = (v, digits) => v === null || !Number.isFinite(v) ? "–" : String(Number(v.toPrecision(digits)));

  // Ticks of a logarithmic axis: 1-2-5 within few decades, powers of ten over many, even steps within half a decade.
  const logTicks = (low, high) => {
    const ticks = [];
    if (high / low < 4) {
      const step = 10 ** Math.floor(Math.log10((high - low) / 2));
      const even = (high - low) / step > 5 ? step * 2 : step;
      for (let k = Math.ceil(low / even); k * even <= high; k++) ticks.push(k * even);
      return ticks;
    }
    const decades = Math.log10(high / low), stride = Math.max(1, Math.ceil(decades / 8));
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high) + 1; e += stride) {
      for (const m of decades < 2.5 ? [1, 2, 5] : [1]) {
        const tick = m * 10 ** e;
        if (tick >= low * 0.999999 && tick <= high * 1.000001) ticks.push(tick);
      }
    }
    return ticks;
  };

  const element = (name, className, content) => {
    const node = document.createElement(name);
    if (className) node.className = className;
    if (content !== undefined) node.textContent = content;
    return node;
  };

  const ascends = (x) => x.every((v, i) => i === 0 || v >= x[i - 1]);

  function buildPanel(figure, spec, data, width, height) {
    const panel = { spec, x: spec.xr.slice(), y: spec.yr.slice() };
    const full = () => ({ x: spec.xr.slice(), y: spec.yr.slice() });
    panel.series = spec.series.map((s) => ({ ...s, x: data.x[s.x], shown: true, ascends: ascends(data.x[s.x]) }));
    if (spec.title) figure.live.append(element("div", "panel-title", spec.title));

    // The keys of the curves are the legend, the switches and the read-out.
    const keys = element("div", "keys");
    panel.place = element("span", "x");
    keys.append(panel.place);
    for (const s of panel.series) {
      if (!s.name) continue;
      s.key = element("button");
      s.key.type = "button";
      s.key.setAttribute("aria-pressed", "true");
      const swatch = element("span", s.style === "points" ? "swatch dots" : "swatch");
      if (s.style === "points") swatch.style.background = s.color;
      else swatch.style.borderTop = `${Math.max(2, s.width)}px ${s.style === "dashed" ? "dashed" : s.style === "instants" ? "dotted" : "solid"} ${s.color}`;
      s.value = element("span", s.ascends ? "value" : "value pair");
      s.key.append(swatch, element("bdi", "", s.name), s.value);
      s.key.addEventListener("click", () => {
        s.shown = !s.shown;
        s.key.setAttribute("aria-pressed", String(s.shown));
        panel.plot.redraw();
      });
      keys.append(s.key);
    }
    figure.live.append(keys);

    const holder = element("div");
    holder.tabIndex = 0;
    holder.setAttribute("role", "group");
    holder.setAttribute("aria-label", figure.alt +
      " Arrow keys read the curves, with Shift they move the axis; plus and minus zoom, 0 shows all.");
    figure.live.append(holder);

    const drawCurves = (u) => {
      const ctx = u.ctx, ratio = uPlot.pxRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      ctx.lineJoin = "round";
      const dot = (px, py, radius) => { ctx.beginPath(); ctx.arc(px, py, radius, 0, 2 * Math.PI); ctx.fill(); };
      for (const s of panel.series) {
        if (!s.shown) continue;
        ctx.strokeStyle = ctx.fillStyle = s.color;
        ctx.lineWidth = s.width * ratio;
        ctx.setLineDash(s.style === "dashed" ? [8 * ratio, 4 * ratio] : []);
        const positive = (v, log) => v !== null && (!log || v > 0);
        const shown = (i, y) => positive(s.x[i], spec.xlog) && positive(y[i], spec.ylog);
        const at = (i, y) => [u.valToPos(s.x[i], "x", true), u.valToPos(y[i], "y", true)];
        if (s.style === "instants") {
          ctx.setLineDash([3 * ratio, 4 * ratio]);
          ctx.beginPath();
          for (let i = 0; i < s.x.length; i++) {
            if (!positive(s.x[i], spec.xlog)) continue;
            const px = u.valToPos(s.x[i], "x", true);
            ctx.moveTo(px, u.bbox.top);
            ctx.lineTo(px, u.bbox.top + u.bbox.height);
          }
          ctx.stroke();
          continue;
        }
        if (s.low && s.style === "band") {
          // Piece by piece, along the high ends and back along the low ones.
          ctx.globalAlpha = 0.25;
          for (let begin = 0; begin < s.x.length; begin++) {
            let end = begin;
            while (end < s.x.length && shown(end, s.low) && shown(end, s.high)) end++;
            if (end === begin) continue;
            ctx.beginPath();
            for (let i = begin; i < end; i++) ctx.lineTo(...at(i, s.high));
            for (let i = end - 1; i >= begin; i--) ctx.lineTo(...at(i, s.low));
            ctx.fill();
            begin = end;
          }
          ctx.globalAlpha = 1;
        } else if (s.low) {
          ctx.lineWidth = ratio;
          for (let i = 0; i < s.x.length; i++) {
            if (!shown(i, s.low) || !shown(i, s.high)) continue;
            const [px, low] = at(i, s.low), high = at(i, s.high)[1], half = 3 * ratio;
            ctx.beginPath();
            for (const end of [low, high]) { ctx.moveTo(px - half, end); ctx.lineTo(px + half, end); }
            ctx.moveTo(px, low);
            ctx.lineTo(px, high);
            ctx.stroke();
          }
          ctx.lineWidth = s.width * ratio;
        }
        let drawing = false, before = 0;
        if (s.style !== "points") ctx.beginPath();
        for (let i = 0; i < s.x.length; i++) {
          if (!shown(i, s.y)) { drawing = false; continue; }
          const [px, py] = at(i, s.y);
          if (s.style === "points") { dot(px, py, 2 * ratio); continue; }
          if (drawing && s.style === "steps") ctx.lineTo(px, before);
          if (drawing) ctx.lineTo(px, py); else ctx.moveTo(px, py);
          drawing = true;
          before = py;
        }
        if (s.style !== "points") ctx.stroke();
        if (s.style !== "line_points") continue;
        for (let i = 0; i < s.x.length; i++) {
          if (shown(i, s.y)) dot(...at(i, s.y), 3 * ratio);
        }
      }
      ctx.restore();
    };

    // The sample nearest to the crosshair: in x for a curve over x, on the screen for a loop.
    const nearest = (u, s, x) => {
      let best = -1, least = Infinity;
      for (let i = 0; i < s.x.length; i++) {
        if (s.x[i] === null || s.y[i] === null) continue;
        const distance = s.ascends ? Math.abs(s.x[i] - x) :
          Math.hypot(u.valToPos(s.x[i], "x") - u.cursor.left, u.valToPos(s.y[i], "y") - u.cursor.top);
        if (distance < least) { least = distance; best = i; }
      }
      // Beyond the ends of a curve there is nothing to read.
      const end = s.ascends && best >= 0 && (x < s.x[0] || x > s.x[s.x.length - 1]);
      return end && least > 0.01 * (panel.x[1] - panel.x[0]) ? -1 : best;
    };
    panel.read = () => {
      const u = panel.plot, on = u.cursor.left >= 0;
      const x = on ? u.posToVal(u.cursor.left, "x") : null;
      panel.place.textContent = on ? `${spec.xname}: ${text(x, 5)}` : "";
      for (const s of panel.series) {
        if (!s.key) continue;
        const i = on && s.shown ? nearest(u, s, x) : -1;
        s.value.textContent = i < 0 ? "" :
          s.style === "instants" ? `: ${text(s.x[i], 5)}` : s.ascends ? `: ${text(s.y[i], 5)}` : `: (${text(s.x[i], 5)}, ${text(s.y[i], 5)})`;
      }
    };

    const axis = (scale, label, log) => ({
      scale, label, labelSize: label ? 22 : 4, labelFont: "13px system-ui, sans-serif", font: "12px system-ui, sans-serif",
      stroke: "#1a1a1a", grid: { stroke: "#ddd", width: 1 }, ticks: { stroke: "#888", width: 1 },
      size: scale === "x" ? 34 : 62,
      values: (u, ticks) => ticks.map((v) => v === null ? "" : Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-4) ?
        Number(v.toPrecision(8)).toExponential() : text(v, 8)),
      ...(log ? { splits: (u, i, low, high) => logTicks(low, high), filter: (u, ticks) => ticks } : {}),
    });
    panel.plot = new uPlot({
      width, height,
      legend: { show: false },
      scales: {
        x: { time: false, distr: spec.xlog ? 3 : 1, auto: false, range: () => panel.x },
        y: { distr: spec.ylog ? 3 : 1, auto: false, range: () => panel.y },
      },
      series: [{}, { show: true, scale: "y" }],
      axes: [axis("x", spec.xlabel, spec.xlog), axis("y", spec.ylabel, spec.ylog)],
      cursor: {
        points: { show: false },
        drag: { x: true, y: true, uni: 30, dist: 5, setScale: false },
        bind: { dblclick: () => () => figure.reset() },
      },
      hooks: {
        draw: [drawCurves],
        setCursor: [() => figure.point(panel)],
        setSelect: [(u) => {
          const { left, top, width: w, height: h } = u.select;
          if (w <= 0 || h <= 0) return;
          const inner = (part, whole) => part < whole - 1;
          figure.zoom(panel,
            inner(w, u.over.clientWidth) ? [u.posToVal(left, "x"), u.posToVal(left + w, "x")] : null,
            inner(h, u.over.clientHeight) ? [u.posToVal(top + h, "y"), u.posToVal(top, "y")] : null);
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
      },
    }, [spec.xr, [null, null]], holder);
    panel.show = (x, y) => {
      if (x) panel.x = x;
      if (y) panel.y = y;
      panel.plot.batch(() => {
        panel.plot.setScale("x", { min: panel.x[0], max: panel.x[1] });
        panel.plot.setScale("y", { min: panel.y[0], max: panel.y[1] });
      });
    };
    panel.full = full;

    holder.addEventListener("keydown", (event) => {
      const u = panel.plot, log = spec.xlog;
      const w = u.over.clientWidth, left = u.cursor.left >= 0 ? u.cursor.left : w / 2;
      const go = (to) => u.setCursor({ left: Math.min(Math.max(to, 0), w), top: u.over.clientHeight / 2 });
      const [a, b] = panel.x.map((v) => log ? Math.log(v) : v);
      const change = (low, high) => figure.zoom(panel, [low, high].map((v) => log ? Math.exp(v) : v), null);
      const side = event.key === "ArrowRight" ? 1 : -1;
      const at = a + (b - a) * left / w;
      switch (event.key) {
        case "ArrowLeft": case "ArrowRight":
          if (event.shiftKey) change(a + side * (b - a) / 10, b + side * (b - a) / 10);
          else go(left + side * w / 100);
          break;
        case "+": change(at - (at - a) / 1.5, at + (b - at) / 1.5); break;
        case "-": change(at - (at - a) * 1.5, at + (b - at) * 1.5); break;
        case "0": case "Escape": figure.reset(); break;
        default: return;
      }
      event.preventDefault();
    });
    return panel;
  }

  function build(node, isFirst) {
    const data = JSON.parse(node.querySelector("script").textContent);
    const image = node.querySelector("img");
    const figure = { alt: image.alt, live: element("div", "live"), panels: [] };
    if (data.title) figure.live.append(element("div", "figure-title", data.title));
    const inner = () => figure.live.clientWidth || 900;
    image.after(figure.live);
    const height = () => Math.max(230, inner() * data.panelHeight);

    const linked = (panel) => figure.panels.filter((other) => other.spec.group === panel.spec.group);
    const showAll = element("button", "", "Show all");
    showAll.type = "button";
    showAll.hidden = true;
    figure.zoom = (panel, x, y) => {
      if (x) for (const other of linked(panel)) other.show(x, null);
      if (y) panel.show(null, y);
      showAll.hidden = false;
    };
    figure.reset = () => {
      for (const panel of figure.panels) { const all = panel.full(); panel.show(all.x, all.y); }
      showAll.hidden = true;
    };
    showAll.addEventListener("click", () => figure.reset());
    // The crosshair moves in all linked panels; setting it calls back here.
    let moving = false;
    figure.point = (panel) => {
      if (panel.plot) panel.read();
      if (moving || !panel.plot) return;
      moving = true;
      panel.plot.root.classList.remove("follows");
      for (const other of linked(panel)) {
        if (other === panel) continue;
        other.plot.root.classList.add("follows");
        other.plot.setCursor({ left: panel.plot.cursor.left, top: panel.plot.cursor.left < 0 ? -10 : 0 }, false);
        other.read();
      }
      moving = false;
    };
    const hint = element("p", "hint", (isFirst ? "Plots: drag to zoom, double-click to show all, click a name to hide " +
      "its curve; by keys, arrows, plus, minus and 0. " : "") + (data.note || ""));
    hint.append(showAll);

    for (const spec of data.panels) figure.panels.push(buildPanel(figure, spec, data, inner(), height()));
    figure.live.append(hint);
    node.classList.add("on");
    // The width is known only now that the image has gone.
    const fit = () => {
      for (const panel of figure.panels) panel.plot.setSize({ width: inner(), height: height() });
    };
    fit();
    let last = inner();
    new ResizeObserver(() => {
      if (figure.live.clientWidth === 0 || figure.live.clientWidth === last) return; // hidden on paper
      last = inner();
      requestAnimationFrame(fit);
    }).observe(figure.live);
  }

  for (const [i, node] of document.querySelectorAll("figure.plot").entries()) {
    try {
      build(node, i === 0);
    } catch (problem) {
      node.querySelector(".live")?.remove(); // the image stays
      console.error(problem);
    }
  }
})();
