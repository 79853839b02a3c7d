//! What a call brings to say who made it.

use crate::net::Peer;
use axum::http::{HeaderMap, header};

/// The cookie that holds the token of a browser that logged in.
pub(crate) const COOKIE: &str = "lexsplat_token";

/// What a call brings to say who made it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Credentials<'a> {
    /// The bearer token.
    pub(crate) token: Option<&'a str>,
    /// The DNS names in the client certificate, which count where there is no token.
    pub(crate) names: &'a [String],
}

impl<'a> Credentials<'a> {
    /// The token of `authorization: Bearer TOKEN`. A header of another form is a wrong token.
    pub(crate) fn of_call(headers: &'a HeaderMap, peer: &'a Peer) -> Self {
        let token = headers.get(header::AUTHORIZATION).map(|value| {
            let text = value.to_str().unwrap_or_default();
            match text.split_once(' ') {
                Some((scheme, token)) if scheme.eq_ignore_ascii_case("bearer") => token.trim(),
                _ => "",
            }
        });
        Self { token, names: &peer.names }
    }

    /// The same, or else the token of the cookie.
    pub(crate) fn of_browser(headers: &'a HeaderMap, peer: &'a Peer) -> Self {
        let known = Self::of_call(headers, peer);
        Self { token: known.token.or_else(|| cookie(headers)), ..known }
    }
}

fn cookie(headers: &HeaderMap) -> Option<&str> {
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = values.flat_map(|value| value.split(';'));
    pairs.find_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::Peer;
    use axum::http::HeaderValue;

    #[test]
    fn tokens_are_read_from_header_and_cookie() {
        let with = |name: &'static str, value: &'static str| {
            HeaderMap::from_iter([(name.parse().unwrap(), HeaderValue::from_static(value))])
        };
        let nobody = Peer::default();
        let token = |of: Credentials<'_>| of.token.map(str::to_owned);
        let of = |headers: &HeaderMap| token(Credentials::of_call(headers, &nobody));
        let of_browser = |headers: &HeaderMap| token(Credentials::of_browser(headers, &nobody));
        assert_eq!(of(&with("authorization", "Bearer abc")).as_deref(), Some("abc"));
        assert_eq!(of(&with("authorization", "bearer  abc ")).as_deref(), Some("abc"));
        for wrong in ["Basic abc", "abc", "", "Bearer"] {
            assert_eq!(of(&with("authorization", wrong)).as_deref(), Some(""), "{wrong}");
        }
        assert_eq!(of(&HeaderMap::new()), None);
        let cookies = with("cookie", "a=1; lexsplat_token=abc; b=2");
        assert_eq!(of(&cookies), None);
        assert_eq!(of_browser(&cookies).as_deref(), Some("abc"));
        assert_eq!(of_browser(&with("cookie", "lexsplat_tokens=abc")), None);
    }
}
