//! `strandflow check`: the rig doctor.

use strandflow_check::{Finding, Said, Verdict, check as check_all, check_to, gather};
use strandflow_engine::confined::must_be_confined;

use crate::{args::CheckArgs, failure::Failed, stdout::print};

/// Columns of the text.
const WIDTH: usize = 100;

pub fn check(args: &CheckArgs) -> Result<(), Failed> {
    if args.confined {
        must_be_confined(&args.take)?;
    }
    let mut evidence = gather::of_folder(&args.take)?;
    let said = match &args.to {
        Some(last) => check_to(&mut evidence, last),
        None => check_all(&mut evidence),
    };
    if args.json {
        print(&(serde_json::to_string_pretty(&said).map_err(std::io::Error::other)? + "\n"))?;
    } else {
        print(&text(&said))?;
    }
    let grave = said.iter().flat_map(|said| &said.findings).filter(|f| f.verdict == Verdict::CannotWork).count();
    if grave > 0 {
        let error = format!("{grave} of the findings cannot work");
        return Err(Failed { error, hint: "mend these first, then check again".into(), input: false });
    }
    Ok(())
}

/// One line a check, and its findings below it.
fn text(said: &[Said]) -> String {
    let mut text = String::new();
    for said in said {
        text += &wrapped(&format!("{:<12}{:<14}", said.check, said.verdict.in_words()), 26, &said.measured);
        said.findings.iter().for_each(|finding| text += &finding_text(finding));
    }
    let count = |verdict: Verdict| said.iter().flat_map(|s| &s.findings).filter(|f| f.verdict == verdict).count();
    let (look, cannot) = (count(Verdict::LookAtThis), count(Verdict::CannotWork));
    text += &match (look, cannot) {
        (0, 0) => "\nSound: nothing stands out.\n".to_owned(),
        _ => format!("\n{cannot} that cannot work, {look} to look at.\n"),
    };
    text
}

fn finding_text(finding: &Finding) -> String {
    let mark = if finding.verdict == Verdict::CannotWork { "!!" } else { " !" };
    let head = format!(" {mark} {}: ", finding.place);
    let mut text = wrapped(&head, 7, &format!("{} [{}]", finding.fact, finding.fault));
    for (what, words) in [("suffers: ", finding.suffers), ("do: ", finding.hint.as_str())] {
        if !words.is_empty() {
            text += &wrapped(&format!("       {what}"), 11, words);
        }
    }
    text
}

/// Text after a head, broken between words, further lines indented.
fn wrapped(head: &str, indent: usize, words: &str) -> String {
    let (mut text, mut column) = (head.to_owned(), head.chars().count());
    let mut first = true;
    for word in words.split(' ') {
        let length = word.chars().count();
        if !first && column + 1 + length > WIDTH {
            text += &format!("\n{}", " ".repeat(indent));
            (column, first) = (indent, true);
        }
        if !first {
            text.push(' ');
            column += 1;
        }
        text += word;
        (column, first) = (column + length, false);
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_within_the_width() {
        let finding = Finding::look("offset", "view cam03", "word ".repeat(60)).suffers("fit").hint("cut ".repeat(40));
        let text = finding_text(&finding);
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH) && text.lines().count() > 5, "{text}");
    }
}
