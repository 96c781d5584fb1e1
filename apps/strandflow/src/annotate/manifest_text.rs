//! The manifest's `[labels]`, changed in its text: comments stay.

/// The text with other values of keys in `[labels]`; keys that it lacks are added, other lines stay as they are.
pub fn with_labels(text: &str, labels: &[(&str, &str)]) -> String {
    let header = |line: &str| line.trim_start().starts_with('[').then(|| line.trim() == "[labels]");
    let mut rest: Vec<&(&str, &str)> = labels.iter().collect();
    let mut lines: Vec<String> = Vec::new();
    let (mut inside, mut begins) = (false, None);
    for line in text.lines() {
        if let Some(is_labels) = header(line) {
            inside = is_labels;
        }
        let key = line.split_once('=').map(|(key, _)| key.trim());
        match rest.iter().position(|(name, _)| inside && key == Some(*name)) {
            Some(at) => lines.push(entry(rest.remove(at))),
            None => lines.push(line.to_owned()),
        }
        if inside && begins.is_none() {
            begins = Some(lines.len());
        }
    }
    let added = rest.into_iter().map(entry);
    match begins {
        Some(at) => lines.splice(at..at, added).for_each(drop),
        None => lines.extend(std::iter::once("\n[labels]".to_owned()).chain(added)),
    }
    lines.join("\n") + "\n"
}

fn entry((key, value): &(&str, &str)) -> String {
    format!("{key} = {}", toml::Value::from(*value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_change_and_comments_stay() {
        let text = "fps = 1\n# mine\n[labels]\n# Markers.\nmarkers = \"/far/m.json\" # old\n[other]\nmarkers = 3\n";
        let new = with_labels(text, &[("markers", "user/m.json"), ("hair_masks", "user/hair \"x\"")]);
        assert!(new.starts_with("fps = 1\n# mine\n[labels]\nhair_masks = "), "{new}");
        let read: toml::Table = new.parse().unwrap();
        assert_eq!(read["labels"]["markers"].as_str(), Some("user/m.json"));
        assert_eq!(read["labels"]["hair_masks"].as_str(), Some("user/hair \"x\""));
        assert_eq!(read["other"]["markers"].as_integer(), Some(3));
        let bare: toml::Table = with_labels("fps = 1\n", &[("markers", "a")]).parse().unwrap();
        assert_eq!(bare["labels"]["markers"].as_str(), Some("a"));
    }
}
