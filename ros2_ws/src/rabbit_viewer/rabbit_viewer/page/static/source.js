// Where a walk comes from: the websocket of this page's server, or what an exported file holds.

const RETRY = 1000; // ms

export function open(on) {
  const inside = document.getElementById("walk-data");
  return inside ? read(JSON.parse(inside.textContent), on) : connect(on);
}

// {words: [...], rows: base64 of gzipped float32}
function read(content, on) {
  for (const word of content.words) on.word(word);
  const bytes = Uint8Array.from(atob(content.rows), (letter) => letter.charCodeAt(0));
  new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer().then(on.rows);
  return {send() {}, isLive: false};
}

function connect(on) {
  let socket;
  const begin = () => {
    socket = new WebSocket(`ws://${location.host}/walk`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => on.connected(true);
    socket.onmessage = ({data}) => (typeof data === "string" ? on.word(JSON.parse(data)) : on.rows(data));
    socket.onclose = () => {
      on.connected(false);
      setTimeout(begin, RETRY);
    };
  };
  begin();
  return {
    isLive: true,
    send(message) {
      if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
  };
}
