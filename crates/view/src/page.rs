//! The page within the program: what `cargo xtask web` built, or a note that says what to run.

include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// What builds the page.
pub const HOW_TO_BUILD: &str = "run `cargo xtask web` in the source folder (it needs Node), then build again";

/// A file of the page: content type and bytes.
#[derive(Clone, Copy, Debug)]
pub struct File {
    /// Content type.
    pub kind: &'static str,
    /// Bytes.
    pub bytes: &'static [u8],
}

/// The page itself.
pub fn index() -> File {
    File { kind: "text/html; charset=utf-8", bytes: INDEX }
}

/// Its script.
pub fn script() -> File {
    File { kind: "text/javascript; charset=utf-8", bytes: SCRIPT }
}

/// Its style.
pub fn style() -> File {
    File { kind: "text/css; charset=utf-8", bytes: STYLE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_there_either_way() {
        let text = std::str::from_utf8(index().bytes).unwrap();
        assert!(text.contains("<title>"), "{text}");
        assert!(IS_BUILT != text.contains("cargo xtask web"));
    }
}
