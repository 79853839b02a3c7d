//! Entity tags and byte ranges of files: `ETag`, `If-None-Match`, `Range`, `If-Range` (RFC 9110).

use super::error::Problem;
use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

/// A file with its entity tag, quotes included.
#[derive(Clone)]
pub(super) struct Tagged {
    pub(super) etag: String,
    pub(super) data: Bytes,
}

/// The part of a file that a request asks for.
#[derive(Debug, PartialEq, Eq)]
enum Part {
    All,
    /// First byte, and the byte after the last.
    Some(usize, usize),
    /// Outside the file.
    Outside,
}

/// Answers a GET request for `file` or a part of it.
pub(super) fn respond(file: Tagged, headers: &HeaderMap, content_type: &'static str) -> Response {
    let Tagged { etag, data } = file;
    let tag = HeaderValue::from_str(&etag).expect("an entity tag is hexadecimal in quotes");
    let common = [
        (header::ETAG, tag),
        (header::ACCEPT_RANGES, HeaderValue::from_static("bytes")),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    if text(header::IF_NONE_MATCH).is_some_and(|tags| matches(tags, &etag)) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    let unchanged = text(header::IF_RANGE).is_none_or(|tag| tag.trim() == etag);
    let wanted = text(header::RANGE).filter(|_| unchanged);
    let total = data.len();
    let typed = [(header::CONTENT_TYPE, HeaderValue::from_static(content_type))];
    match wanted.map_or(Part::All, |range| part(range, total)) {
        Part::All => (common, typed, data).into_response(),
        Part::Some(from, to) => {
            let range = [(header::CONTENT_RANGE, format!("bytes {from}-{}/{total}", to - 1))];
            (StatusCode::PARTIAL_CONTENT, common, typed, range, data.slice(from..to))
                .into_response()
        }
        Part::Outside => {
            let detail = format!("the file has {total} bytes: the range is outside");
            let range = [(header::CONTENT_RANGE, format!("bytes */{total}"))];
            let problem = Problem::new(StatusCode::RANGE_NOT_SATISFIABLE, detail).at("range");
            (range, problem).into_response()
        }
    }
}

fn matches(tags: &str, etag: &str) -> bool {
    tags.split(',')
        .map(|tag| tag.trim().trim_start_matches("W/"))
        .any(|tag| tag == "*" || tag == etag)
}

/// Reads one range of bytes. Several ranges and malformed ranges mean the whole file, as the RFC
/// allows.
fn part(range: &str, total: usize) -> Part {
    let Some(spec) = range.trim().strip_prefix("bytes=") else { return Part::All };
    let Some((first, last)) = spec.split_once('-') else { return Part::All };
    let (first, last) = (first.trim(), last.trim());
    match (first.parse::<usize>(), last.parse::<usize>()) {
        (Err(_), Ok(0)) if first.is_empty() => Part::Outside,
        (Err(_), Ok(_)) if first.is_empty() && total == 0 => Part::Outside,
        (Err(_), Ok(count)) if first.is_empty() => Part::Some(total.saturating_sub(count), total),
        (Ok(first), Ok(last)) if first > last => Part::All,
        (Ok(first), _) if first >= total && (last.is_empty() || last.parse::<usize>().is_ok()) => {
            Part::Outside
        }
        (Ok(first), Ok(last)) => Part::Some(first, last.saturating_add(1).min(total)),
        (Ok(first), Err(_)) if last.is_empty() => Part::Some(first, total),
        _ => Part::All,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_the_rfc_says() {
        assert_eq!(part("bytes=0-4", 10), Part::Some(0, 5));
        assert_eq!(part("bytes=4-", 10), Part::Some(4, 10));
        assert_eq!(part("bytes=-3", 10), Part::Some(7, 10));
        assert_eq!(part("bytes=-30", 10), Part::Some(0, 10));
        assert_eq!(part("bytes=5-500", 10), Part::Some(5, 10));
        assert_eq!(part("bytes=10-", 10), Part::Outside);
        assert_eq!(part("bytes=-0", 10), Part::Outside);
        assert_eq!(part("bytes=0-", 0), Part::Outside);
        for whole in ["bytes=5-4", "bytes=0-1,3-4", "bytes=x-", "items=0-1", "bytes=-"] {
            assert_eq!(part(whole, 10), Part::All, "{whole}");
        }
    }

    fn ask(headers: &[(header::HeaderName, &'static str)]) -> Response {
        let file = Tagged { etag: "\"abc\"".into(), data: Bytes::from_static(b"0123456789") };
        let headers = headers
            .iter()
            .map(|(name, value)| (name.clone(), HeaderValue::from_static(value)))
            .collect();
        respond(file, &headers, "text/plain")
    }

    async fn body(response: Response) -> Bytes {
        axum::body::to_bytes(response.into_body(), 100).await.unwrap()
    }

    #[tokio::test]
    async fn parts_and_tags_are_honoured() {
        let whole = ask(&[]);
        assert_eq!(whole.status(), StatusCode::OK);
        assert_eq!(whole.headers()[header::ETAG], "\"abc\"");
        assert_eq!(body(whole).await.len(), 10);

        let some = ask(&[(header::RANGE, "bytes=2-4"), (header::IF_RANGE, "\"abc\"")]);
        assert_eq!(some.status(), StatusCode::PARTIAL_CONTENT);
        assert_eq!(some.headers()[header::CONTENT_RANGE], "bytes 2-4/10");
        assert_eq!(&body(some).await[..], b"234");

        let changed = ask(&[(header::RANGE, "bytes=2-4"), (header::IF_RANGE, "\"old\"")]);
        assert_eq!(changed.status(), StatusCode::OK);
        let same = ask(&[(header::IF_NONE_MATCH, "\"x\", W/\"abc\"")]);
        assert_eq!(same.status(), StatusCode::NOT_MODIFIED);
        let other = ask(&[(header::IF_NONE_MATCH, "\"x\"")]);
        assert_eq!(other.status(), StatusCode::OK);
        let outside = ask(&[(header::RANGE, "bytes=10-")]);
        assert_eq!(outside.status(), StatusCode::RANGE_NOT_SATISFIABLE);
        assert_eq!(outside.headers()[header::CONTENT_RANGE], "bytes */10");
    }
}
