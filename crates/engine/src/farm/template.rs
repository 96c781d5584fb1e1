//! Tasks as text for other schedulers: templates with places for what changes.
//!
//! `{{NAME}}` stands for a name or a number, `{{NAME:FORM}}` for a value that may hold any character, written in the form that
//! its place needs. What stands between `{{#arrays}}` and `{{/arrays}}` is repeated for each array; within it, `after` for each
//! array that it waits for, `words` for each word of the command without the items, and `arguments` for each but the program. The newline
//! behind one of these is no part of the text. `docs/farm.md` lists values and forms.

use std::collections::BTreeMap;

use crate::{
    EngineError,
    farm::{Array, Work, script::quoted},
};

/// The templates that come with the program: name, text.
pub const TEMPLATES: [(&str, &str); 3] = [
    ("deadline", include_str!("template/deadline.txt")),
    ("kubernetes", include_str!("template/kubernetes.yaml")),
    ("opencue", include_str!("template/opencue.xml")),
];

/// Values that may hold any character, and have no plain form.
const PATHS: [&str; 3] = ["program", "take", "word"];

/// What a part of a template can speak of.
#[derive(Clone, Default)]
struct Scope {
    values: BTreeMap<&'static str, String>,
    parts: BTreeMap<&'static str, Vec<Scope>>,
}

impl Scope {
    fn of(values: impl IntoIterator<Item = (&'static str, String)>) -> Self {
        Self { values: values.into_iter().collect(), parts: BTreeMap::new() }
    }

    /// Of what is inside; what is outside stays visible.
    fn within(&self, outer: &Self) -> Self {
        let mut all = outer.clone();
        all.values.extend(self.values.clone());
        all.parts.extend(self.parts.clone());
        all
    }
}

/// Renders a template; `name` is for messages.
///
/// # Errors
/// `Input` for a place that has no such value or form, a value that the form cannot hold, or a part that does not end.
pub fn render(name: &str, template: &str, arrays: &[Array], work: &Work) -> Result<String, EngineError> {
    let mut take = Scope::of([("program", work.program.clone()), ("take", work.take.clone())]);
    take.parts.insert("arrays", arrays.iter().map(|array| of_array(array, work)).collect());
    fill(template, &take).map_err(|fact| EngineError::input(name, fact, "docs/farm.md says what a template can hold"))
}

fn of_array(array: &Array, work: &Work) -> Scope {
    let mut scope = Scope::of([
        ("phase", array.phase().to_owned()),
        ("job", job_name(array.phase())),
        ("tasks", array.task_count().to_string()),
        ("last_task", (array.task_count() - 1).to_string()),
        ("per_task", array.per_task.to_string()),
    ]);
    let word = |word: String| Scope::of([("word", word)]);
    let words: Vec<Scope> = work.words(&array.phases).into_iter().map(word).collect();
    scope.parts.insert("arguments", words[1..].to_vec());
    scope.parts.insert("words", words);
    let after = |phase: &str| Scope::of([("before", job_name(phase))]);
    scope.parts.insert("after", array.after.iter().map(|other| after(other.phase)).collect());
    scope
}

/// The phase as a name that every scheduler takes: small letters, digits, hyphens.
fn job_name(phase: &str) -> String {
    format!("strandflow-{}", phase.replace('/', "-"))
}

/// Fills places from left to right; what a value holds is never looked at again.
fn fill(text: &str, scope: &Scope) -> Result<String, String> {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once("{{") {
        out += before;
        let (place, behind) = behind.split_once("}}").ok_or("`{{` has no `}}`")?;
        if let Some(name) = place.strip_prefix('#') {
            let end = format!("{{{{/{name}}}}}");
            let (part, behind) = behind.split_once(&end).ok_or_else(|| format!("`{{{{#{name}}}}}` has no `{end}`"))?;
            let inner = scope.parts.get(name).ok_or_else(|| format!("there is no part `{name}`"))?;
            for inner in inner {
                out += &fill(without_newline(part), &inner.within(scope))?;
            }
            rest = without_newline(behind);
        } else {
            let (name, form) = place.split_once(':').map_or((place, None), |(name, form)| (name, Some(form)));
            let value = scope.values.get(name).ok_or_else(|| format!("there is no value `{name}`"))?;
            out += &written(name, value, form)?;
            rest = behind;
        }
    }
    Ok(out + rest)
}

fn without_newline(text: &str) -> &str {
    text.strip_prefix('\n').unwrap_or(text)
}

fn written(name: &str, value: &str, form: Option<&str>) -> Result<String, String> {
    let json = |value: &str| serde_json::to_string(value).map_err(|error| error.to_string());
    match form {
        None if PATHS.contains(&name) => Err(format!("`{name}` can hold any character: give a form")),
        None => Ok(value.to_owned()),
        Some("json") => json(value),
        // Kubernetes replaces `$(NAME)` in commands and reads `$$` as `$`.
        Some("kubernetes") => json(&value.replace('$', "$$")),
        Some("sh") => Ok(quoted(value)),
        Some("sh-xml") => Ok(in_xml(&quoted(value))),
        Some("xml") => Ok(in_xml(value)),
        Some("deadline") => in_quotes(value),
        Some(form) => Err(format!("`{name}` has no form `{form}`")),
    }
}

/// Deadline has no way to write a quote, an angle bracket or a line's end within an argument.
fn in_quotes(value: &str) -> Result<String, String> {
    let bad = value.chars().find(|c| c.is_control() || "\"\\<>".contains(*c));
    bad.map_or_else(
        || Ok(format!("\"{value}\"")),
        |c| Err(format!("`{value}` holds {c:?}, which Deadline cannot pass on")),
    )
}

fn in_xml(value: &str) -> String {
    let mut out = String::new();
    for c in value.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&apos;",
            c if c.is_control() => out += &format!("&#{};", u32::from(c)),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::After;

    fn arrays() -> Vec<Array> {
        let array = |phase, per_task, after: Vec<After>| Array {
            phases: vec![phase],
            parts: 25,
            per_task,
            tasks: vec![0],
            in_order: false,
            after,
        };
        let after = After { phase: "hull/hull", corresponding: true };
        vec![array("hull/hull", 10, Vec::new()), array("lift/lift", 25, vec![after])]
    }

    fn work(take: &str) -> Work {
        Work { program: "/opt/strandflow".into(), take: take.into(), more: vec!["--threads".into(), "2".into()] }
    }

    #[test]
    fn what_a_path_holds_is_not_read_as_a_template() {
        let text = "{{#arrays}}{{job}} {{tasks}}:{{#words}} {{word:sh}}{{/words}}{{#after}} <{{before}}{{/after}} .\n{{/arrays}}";
        let rendered = render("test", text, &arrays(), &work("/{{take}}/{{#words}}")).unwrap();
        let lines: Vec<&str> = rendered.lines().collect();
        assert!(
            lines[0].starts_with("strandflow-hull-hull 3: '/opt/strandflow' 'run' '/{{take}}/{{#words}}'"),
            "{rendered}"
        );
        assert!(lines[1].ends_with("'--threads' '2' <strandflow-hull-hull ."), "{rendered}");
    }

    #[test]
    fn paths_have_no_plain_form_and_mistakes_are_named() {
        for (text, wanted) in [
            ("{{take}}", "give a form"),
            ("{{nothing}}", "no value `nothing`"),
            ("{{take:yaml}}", "no form `yaml`"),
            ("{{#arrays}}", "has no `{{/arrays}}`"),
            ("{{#jobs}}{{/jobs}}", "no part `jobs`"),
        ] {
            let error = render("mine.txt", text, &arrays(), &work("/take")).unwrap_err().to_string();
            assert!(error.starts_with("mine.txt: ") && error.contains(wanted), "{error}");
        }
        let deadline = TEMPLATES[0].1;
        assert!(render("deadline", deadline, &arrays(), &work("/a\"b")).unwrap_err().to_string().contains("Deadline"));
    }

    #[test]
    fn markup_is_escaped() {
        assert_eq!(written("take", "<a & 'b'>", Some("xml")).unwrap(), "&lt;a &amp; &apos;b&apos;&gt;");
        assert_eq!(written("take", "/$(HOME)\n", Some("kubernetes")).unwrap(), "\"/$$(HOME)\\n\"");
    }
}
