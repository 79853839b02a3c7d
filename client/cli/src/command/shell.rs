//! `lexsplat completions` and `lexsplat man`: what shells and `man` want to know of the command line. Both
//! are written from its definition.

use crate::files::{make_folder, save};
use crate::output::{self, is_standard};
use anyhow::{Context as _, Result};
use clap_complete::Shell;
use clap_mangen::Man as Page;
use std::path::{Path, PathBuf};

/// Print the completions for a shell
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat completions bash > \
                        ~/.local/share/bash-completion/completions/lexsplat\n  \
                        lexsplat completions zsh > ~/.zfunc/_lexsplat")]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Write the manual: a page for each command
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  lexsplat man ~/.local/share/man/man1 && man lexsplat-query\n  \
                        lexsplat man - | man -l -"
)]
pub struct Man {
    /// Folder for lexsplat.1, lexsplat-query.1 and so on, made if missing; -: the first page on standard
    /// output
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Runs `completions`.
pub fn completions(arguments: &Completions, mut line: clap::Command) -> Result<()> {
    let mut script = Vec::new();
    let name = line.get_name().to_owned();
    clap_complete::generate(arguments.shell, &mut line, name, &mut script);
    Ok(output::bytes(&script)?)
}

/// Runs `man`.
pub fn man(arguments: &Man, mut line: clap::Command) -> Result<()> {
    line.build();
    if is_standard(&arguments.folder) {
        return Ok(output::bytes(&page(&line)?)?);
    }
    make_folder(&arguments.folder)?;
    let count = write_below(&line, &arguments.folder)?;
    say!("wrote {count} pages to {}", arguments.folder.display())?;
    Ok(())
}

/// Writes the pages of a command and those below it; how many.
fn write_below(line: &clap::Command, folder: &Path) -> Result<usize> {
    let name = line.get_display_name().unwrap_or_else(|| line.get_name());
    save(&folder.join(format!("{name}.1")), page(line)?)?;
    let shown = line.get_subcommands().filter(|below| below.get_name() != "help");
    shown.map(|below| write_below(below, folder)).try_fold(1, |sum, count| Ok(sum + count?))
}

fn page(line: &clap::Command) -> Result<Vec<u8>> {
    let mut page = Vec::new();
    Page::new(line.clone()).render(&mut page).context("cannot write a page of the manual")?;
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn every_command_has_a_page_and_is_completed() {
        let folder = tempfile::tempdir().unwrap();
        let mut line = crate::Arguments::command();
        line.build();
        let count = write_below(&line, folder.path()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), count);
        let mut script = Vec::new();
        clap_complete::generate(Shell::Bash, &mut line, "lexsplat", &mut script);
        let script = String::from_utf8(script).unwrap();
        for name in ["query", "stream", "maps-backup"] {
            let page = std::fs::read_to_string(folder.path().join(format!("lexsplat-{name}.1")));
            let page = page.unwrap();
            assert!(page.starts_with(".ie") && page.contains(".TH"), "{name}: {page}");
            assert!(script.contains(name.rsplit('-').next().unwrap()), "{name}");
        }
        // Negative control: what is no command is in neither.
        assert!(!folder.path().join("lexsplat-nothing.1").exists());
        assert!(!script.contains("nothing-of-the-kind"));
    }
}
