//! One file of the page: its headers, and its gzipped form for browsers that take it.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest as _, Sha256};
use std::io::Write as _;
use std::sync::Arc;
use tokio::sync::OnceCell;

/// Content security policy: scripts, styles and requests only from and to this server. The renderer of the 3D
/// view is partly WebAssembly and sorts splats in a worker, whose script is in the file of the renderer.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src blob:; \
                      img-src 'self' blob: data:; object-src 'none'; frame-ancestors 'none'";

/// A file that is compiled into the binary.
#[derive(Clone)]
pub(super) struct File {
    kind: &'static str,
    text: &'static str,
    /// Made when it is first asked for.
    forms: Arc<OnceCell<Forms>>,
}

/// What the text becomes on the wire.
#[derive(Clone)]
struct Forms {
    etag: HeaderValue,
    gzipped: Bytes,
}

impl File {
    pub(super) fn new(kind: &'static str, text: &'static str) -> Self {
        Self { kind, text, forms: Arc::default() }
    }

    /// The file, or that it has not changed since the browser got it.
    pub(super) async fn answer(&self, request: &HeaderMap) -> Response {
        let Self { text, .. } = *self;
        let forms = self.forms.get_or_init(async || {
            let made = tokio::task::spawn_blocking(move || Forms::of(text)).await;
            made.expect("gzip takes every text")
        });
        let Forms { etag, gzipped } = forms.await.clone();
        let common: [(HeaderName, HeaderValue); 6] = [
            (header::CONTENT_TYPE, HeaderValue::from_static(self.kind)),
            (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
            (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
            (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
            (header::VARY, HeaderValue::from_static("accept-encoding")),
            (header::ETAG, etag.clone()),
        ];
        let has = |name, word: &[u8]| {
            let values = request.get_all(name).iter();
            values.into_iter().any(|value: &HeaderValue| {
                value.as_bytes().windows(word.len()).any(|part| part == word)
            })
        };
        if has(header::IF_NONE_MATCH, etag.as_bytes()) {
            return (StatusCode::NOT_MODIFIED, common).into_response();
        }
        match has(header::ACCEPT_ENCODING, b"gzip") {
            true => (common, [(header::CONTENT_ENCODING, "gzip")], gzipped).into_response(),
            false => (common, text).into_response(),
        }
    }
}

impl Forms {
    fn of(text: &str) -> Self {
        let digest = Sha256::digest(text);
        let hex: String = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
        gzip.write_all(text.as_bytes()).expect("a vector takes all bytes");
        let gzipped = gzip.finish().expect("a vector takes all bytes").into();
        // Weak, since it is the same for both encodings.
        let etag = format!("W/\"{hex}\"").parse().expect("an entity tag is hexadecimal in quotes");
        Self { etag, gzipped }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::to_bytes;
    use std::io::Read as _;

    #[tokio::test]
    async fn a_file_is_sent_gzipped_plainly_or_not_again() {
        let file = File::new("text/plain", "wall ".repeat(100).leak());
        let ask = async |name: HeaderName, value: &str| {
            let headers = HeaderMap::from_iter([(name, value.parse().unwrap())]);
            let (head, body) = file.answer(&headers).await.into_parts();
            (head, to_bytes(body, usize::MAX).await.unwrap())
        };
        let (head, zipped) = ask(header::ACCEPT_ENCODING, "br, gzip").await;
        assert_eq!(head.headers["content-encoding"], "gzip");
        let mut text = String::new();
        flate2::read::GzDecoder::new(&zipped[..]).read_to_string(&mut text).unwrap();
        assert!(zipped.len() < 100 && text == file.text);
        let etag = head.headers["etag"].to_str().unwrap().to_owned();
        assert_eq!(ask(header::IF_NONE_MATCH, &etag).await.0.status, StatusCode::NOT_MODIFIED);
        // Negative controls: another tag, and a browser that takes no gzip.
        let (head, plain) = ask(header::IF_NONE_MATCH, "W/\"0\"").await;
        assert!(head.status == StatusCode::OK && plain == file.text);
        assert!(!head.headers.contains_key("content-encoding"));
    }
}
