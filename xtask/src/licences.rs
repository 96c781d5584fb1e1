//! `cargo xtask licences`: other people's crates must be permissive, and come from the registry.

use crate::{cargo, said};

/// Licences that ask for no more than to be named.
const PERMISSIVE: [&str; 12] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Looks at every crate of the lock file.
pub fn licences() -> Result<(), String> {
    let text = said(cargo().args(["metadata", "--format-version", "1", "--locked"]))?;
    let metadata: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| format!("cargo metadata: {error}"))?;
    let packages = metadata["packages"].as_array().ok_or("cargo metadata: no packages")?;
    let wrong: Vec<String> = packages.iter().filter_map(objection).collect();
    if wrong.is_empty() {
        eprintln!("licences: {} crates, all permissive", packages.len());
        return Ok(());
    }
    Err(wrong.join("\n"))
}

fn objection(package: &serde_json::Value) -> Option<String> {
    let text = |field: &str| package[field].as_str().unwrap_or_default();
    let named = format!("{} {}", text("name"), text("version"));
    // Of the workspace there is no source.
    if !package["source"].is_null() && !text("source").starts_with("registry+") {
        return Some(format!("{named}: comes from {}", text("source")));
    }
    (!is_permissive(text("license"))).then(|| format!("{named}: licence `{}`", text("license")))
}

/// Whether an expression leaves a choice that is permissive. A slash is an old way to write `OR`.
fn is_permissive(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    either(&expression.split_whitespace().collect::<Vec<_>>().join(" ").replace("( ", "(").replace(" )", ")"))
}

/// `OR` binds less than `AND`.
fn either(expression: &str) -> bool {
    outside_brackets(expression, " OR ").iter().any(|part| outside_brackets(part, " AND ").iter().all(|part| one(part)))
}

fn one(part: &str) -> bool {
    match part.strip_prefix('(').and_then(|part| part.strip_suffix(')')) {
        Some(inside) => either(inside),
        None => PERMISSIVE.contains(&part),
    }
}

fn outside_brackets<'a>(text: &'a str, by: &str) -> Vec<&'a str> {
    let (mut parts, mut depth, mut start, mut at) = (Vec::new(), 0, 0, 0);
    while at < text.len() {
        match text.as_bytes()[at] {
            b'(' => depth += 1,
            b')' => depth -= 1,
            _ if depth == 0 && text[at..].starts_with(by) => {
                parts.push(&text[start..at]);
                start = at + by.len();
            }
            _ => {}
        }
        at += 1;
        while !text.is_char_boundary(at) {
            at += 1;
        }
    }
    parts.push(&text[start..]);
    parts
}

#[cfg(test)]
mod tests {
    use super::is_permissive;

    #[test]
    fn a_choice_is_enough_and_a_duty_is_too_much() {
        for yes in [
            "MIT",
            "MIT/Apache-2.0",
            "Apache-2.0 / MIT",
            "MIT OR LGPL-2.1-or-later",
            "(MIT OR Apache-2.0) AND Unicode-3.0",
        ] {
            assert!(is_permissive(yes), "{yes}");
        }
        for no in ["", "GPL-3.0", "MIT AND GPL-3.0", "(MIT OR Apache-2.0) AND MPL-2.0", "LicenseRef-MIT"] {
            assert!(!is_permissive(no), "{no}");
        }
    }
}
