//! The pages within the program: what `cargo xtask web` built, or a note that says what to run.

include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// What builds the pages.
pub const HOW_TO_BUILD: &str = "run `cargo xtask web` in the source folder (it needs Node), then build again";

/// A file of a page: content type and bytes.
#[derive(Clone, Copy, Debug)]
pub struct File {
    /// Content type.
    pub kind: &'static str,
    /// Bytes.
    pub bytes: &'static [u8],
}

/// A page: its text, its script, its style.
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// The page itself.
    pub index: File,
    /// Its script.
    pub script: File,
    /// Its style.
    pub style: File,
}

const fn page(index: &'static [u8], script: &'static [u8], style: &'static [u8]) -> Page {
    Page {
        index: File { kind: "text/html; charset=utf-8", bytes: index },
        script: File { kind: "text/javascript; charset=utf-8", bytes: script },
        style: File { kind: "text/css; charset=utf-8", bytes: style },
    }
}

/// The page of `strandflow view`.
pub const VIEW: Page = page(VIEW_INDEX, VIEW_SCRIPT, VIEW_STYLE);

/// The page of `strandflow annotate`.
pub const ANNOTATE: Page = page(ANNOTATE_INDEX, ANNOTATE_SCRIPT, ANNOTATE_STYLE);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_there_either_way() {
        for page in [VIEW, ANNOTATE] {
            let text = std::str::from_utf8(page.index.bytes).unwrap();
            assert!(text.contains("<title>"), "{text}");
            assert!(IS_BUILT != text.contains("cargo xtask web"));
        }
    }
}
