// The camera's picture with the boxes of the tracks.

const STALE_MS = 1000;

export class CameraView {
  constructor(canvas, placeholder) {
    this.canvas = canvas;
    this.placeholder = placeholder;
    this.tracks = null;
    this.busy = false;
  }

  // sensor_msgs/CompressedImage. While the browser still decodes one, the next waits, and the newest stays.
  async onPicture(message) {
    this.next = message;
    if (this.busy) return;
    this.busy = true;
    while (this.next) {
      const picture = this.next;
      this.next = null;
      try {
        const bitmap = await createImageBitmap(new Blob([picture.data], {type: 'image/jpeg'}));
        const full = /(\d+)x(\d+)/.exec(picture.format);
        this.size = full ? [Number(full[1]), Number(full[2])] : [bitmap.width, bitmap.height];
        if (this.bitmap) this.bitmap.close();
        this.bitmap = bitmap;
        this.draw();
      } catch (error) {
        console.warn('a picture is not shown:', error);
      }
    }
    this.busy = false;
  }

  onTracks(message) {
    this.tracks = {list: message.tracks, came: Date.now()};
    this.draw();
  }

  draw() {
    const {canvas, bitmap} = this;
    if (!bitmap) return;
    this.placeholder.hidden = true;
    canvas.hidden = false;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
    }
    const context = canvas.getContext('2d');
    context.drawImage(bitmap, 0, 0);
    if (!this.tracks || Date.now() - this.tracks.came > STALE_MS) return;
    const scale = bitmap.width / this.size[0];
    const line = Math.max(2, bitmap.width / 320);
    context.lineWidth = line;
    context.font = `600 ${Math.max(11, Math.round(bitmap.width / 34))}px system-ui, sans-serif`;
    context.textBaseline = 'bottom';
    const style = getComputedStyle(canvas);
    for (const track of this.tracks.list) {
      const {center, size_x: w, size_y: h} = track.bbox;
      const [x, y] = [(center.x - w / 2) * scale, (center.y - h / 2) * scale];
      const colour = style.getPropertyValue(track.label === 'person' ? '--person' : '--thing').trim();
      context.strokeStyle = colour;
      context.strokeRect(x, y, w * scale, h * scale);
      const text = `${track.label} ${Math.round(track.score * 100)} %`;
      const height = parseInt(context.font.split(' ')[1], 10) + 6;
      const top = y < height ? y + height : y;
      context.fillStyle = colour;
      context.fillRect(x - line / 2, top - height, context.measureText(text).width + 8, height);
      context.fillStyle = '#fff';
      context.fillText(text, x + 4 - line / 2, top - 3);
    }
  }
}
