// The picture of a frame: resistivity in colours, touches as circles. Data: float32 rows from below, the model's other traits as in widget.py.
function colour(part) {
  // Black over blue and orange to pale yellow: lightness rises evenly.
  const stops = [[13, 8, 40], [64, 32, 120], [190, 60, 80], [250, 150, 40], [250, 250, 190]];
  const at = Math.min(Math.max(part, 0), 1) * (stops.length - 1);
  const k = Math.min(Math.floor(at), stops.length - 2);
  return stops[k].map((c, i) => c + (at - k) * (stops[k + 1][i] - c));
}

function draw(canvas, model) {
  const [rows, columns] = model.get("shape");
  const [left, right, bottom, top] = model.get("extent_mm");
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!rows || !columns) return;
  const data = model.get("image");
  const values = new Float32Array(data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength));
  const small = new OffscreenCanvas(columns, rows);
  const pixels = new ImageData(columns, rows);
  const most = model.get("most_rise");
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const value = values[row * columns + column];
      if (Number.isNaN(value)) continue;
      const [r, g, b] = colour(Math.abs(value) / most);
      pixels.data.set([r, g, b, 255], 4 * ((rows - 1 - row) * columns + column));
    }
  }
  small.getContext("2d").putImageData(pixels, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(small, 0, 0, canvas.width, canvas.height);
  const scale = canvas.width / (right - left);
  context.strokeStyle = context.fillStyle = "#7fe3ff";
  context.lineWidth = 2;
  context.font = "13px sans-serif";
  for (const touch of model.get("touches")) {
    const [x, y] = [(touch.x_mm - left) * scale, (top - touch.y_mm) * scale];
    const radius = Math.sqrt(touch.area_mm2 / Math.PI) * scale;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
    context.fillText(touch.label, x + radius + 4, y - 4);
  }
}

function render({ model, el }) {
  const root = document.createElement("div");
  const canvas = document.createElement("canvas");
  const caption = document.createElement("div");
  const [left, right, bottom, top] = model.get("extent_mm");
  canvas.width = model.get("width_px");
  canvas.height = Math.round((canvas.width * (top - bottom)) / (right - left)) || canvas.width;
  canvas.style.maxWidth = "100%";
  canvas.setAttribute("role", "img");
  caption.style.cssText = "font: 13px sans-serif; min-height: 1.4em";
  const update = () => {
    const [left, right, bottom, top] = model.get("extent_mm");
    const height = Math.round((canvas.width * (top - bottom)) / (right - left));
    if (height > 0 && canvas.height !== height) canvas.height = height;
    draw(canvas, model);
    caption.textContent = model.get("caption");
    canvas.setAttribute("aria-label", "Picture of the skin. " + model.get("caption"));
  };
  // One event for all of a frame's traits: the caption is set last.
  model.on("change:frame_number", update);
  root.append(canvas, caption);
  el.append(root);
  update();
  return () => model.off("change:frame_number", update);
}

export default { render };
