//! Who may ask, and what a browser may do with the answers.

use axum::http::{HeaderMap, HeaderName, HeaderValue, header};

use crate::Token;

/// Whether a `Host` header names this machine itself, at any port (a tunnel's end has another one). A page of the network whose
/// name was bound to 127.0.0.1 sends its own name, and is refused.
pub fn is_loopback(host: &str) -> bool {
    let (name, port) = match host.strip_prefix("[::1]") {
        Some(rest) => ("localhost", rest.strip_prefix(':')),
        None => host.split_once(':').map_or((host, None), |(name, port)| (name, Some(port))),
    };
    let tail_is_port = host.strip_prefix("[::1]").is_none_or(|rest| rest.is_empty() || rest.starts_with(':'));
    let port_is_number = port.is_none_or(|port| port.parse::<u16>().is_ok());
    (name.eq_ignore_ascii_case("localhost") || name == "127.0.0.1") && tail_is_port && port_is_number
}

/// Whether an `Origin` header names the page that the `Host` header names. Browsers send it with every request that writes.
pub fn is_own_origin(origin: &str, host: &str) -> bool {
    origin.strip_prefix("http://").is_some_and(|own| own.eq_ignore_ascii_case(host))
}

/// Whether the headers carry `Authorization: Bearer T`.
pub fn bears(headers: &HeaderMap, token: &Token) -> bool {
    let given = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    given.and_then(|value| value.strip_prefix("Bearer ")).is_some_and(|given| token.matches(given))
}

/// Scripts, styles and connections of this origin alone; images also of the page's own making.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src 'self' blob: data:; worker-src 'self' blob:; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";

/// Headers of every answer: nothing is kept, guessed, embedded elsewhere or told to others.
pub fn security_headers() -> [(HeaderName, HeaderValue); 6] {
    let is = HeaderValue::from_static;
    [
        (header::CONTENT_SECURITY_POLICY, is(POLICY)),
        (header::CACHE_CONTROL, is("no-store")),
        (header::X_CONTENT_TYPE_OPTIONS, is("nosniff")),
        (header::REFERRER_POLICY, is("no-referrer")),
        (HeaderName::from_static("cross-origin-resource-policy"), is("same-origin")),
        (HeaderName::from_static("cross-origin-opener-policy"), is("same-origin")),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_names_are_answered() {
        for good in ["127.0.0.1", "127.0.0.1:8470", "localhost:1", "LocalHost", "[::1]", "[::1]:8470"] {
            assert!(is_loopback(good), "{good}");
        }
        let bad =
            ["", "example.org", "example.org:8470", "127.0.0.1.example.org", "127.0.0.2", "localhost:x", "[::1]x"];
        bad.iter().for_each(|bad| assert!(!is_loopback(bad), "{bad}"));
    }

    #[test]
    fn other_pages_are_other_origins() {
        assert!(is_own_origin("http://localhost:9", "localhost:9") && is_own_origin("http://[::1]:9", "[::1]:9"));
        for other in ["null", "", "https://localhost:9", "http://localhost:8", "http://evil.example", "localhost:9"] {
            assert!(!is_own_origin(other, "localhost:9"), "{other}");
        }
    }

    #[test]
    fn the_token_is_found_in_its_header() {
        let token = Token::random().unwrap();
        let mut headers = HeaderMap::new();
        assert!(!bears(&headers, &token));
        headers.insert(header::AUTHORIZATION, HeaderValue::from_str(&format!("Bearer {token}")).unwrap());
        assert!(bears(&headers, &token));
        headers.insert(header::AUTHORIZATION, HeaderValue::from_str(&token.to_string()).unwrap());
        assert!(!bears(&headers, &token));
    }
}
