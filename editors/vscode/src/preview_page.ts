// The page of the preview, without VS Code: a picture, its title, and a message.

/** The content of the page. With a message and no picture, the last picture stays, in pale colours. */
export interface Shown {
    title?: string;
    svg?: string;
    message?: string;
}

/**
 * Return the HTML of the page. It shows each `Shown` that is posted to it. The picture is an image, so that nothing in
 * it can run or load anything.
 */
export function previewPage(nonce: string): string {
    return `<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'nonce-${nonce}'; script-src 'nonce-${nonce}'">
<title>Picture</title>
<style nonce="${nonce}">
    body { margin: 0; padding: 1rem; font: var(--vscode-font-size) var(--vscode-font-family); }
    h1 { margin: 0 0 0.75rem; font-size: 1.1em; font-weight: 600; }
    p { margin: 0 0 0.75rem; white-space: pre-wrap; color: var(--vscode-errorForeground); }
    img { display: block; max-width: 100%; background: white; border-radius: 4px; }
    p:not(:empty) ~ img { opacity: 0.4; }
    img:not([src]), p:empty, h1:empty { display: none; }
</style>
</head>
<body>
<h1></h1>
<p role="status"></p>
<img alt="">
<script nonce="${nonce}">
    const [title, message, image] = ["h1", "p", "img"].map((name) => document.querySelector(name));
    addEventListener("message", ({ data }) => {
        message.textContent = data.message ?? "";
        if (data.svg !== undefined) {
            title.textContent = image.alt = data.title;
            image.src = "data:image/svg+xml," + encodeURIComponent(data.svg);
        }
    });
</script>
</body>
</html>
`;
}
