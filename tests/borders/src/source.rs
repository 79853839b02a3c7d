//! A crate's files and modules, as syntax trees.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Texts of `.rs` files by their path below the source folder.
pub type Sources = BTreeMap<PathBuf, String>;

/// Reads every `.rs` file below a folder.
///
/// # Errors
/// Says which folder or file cannot be read.
pub fn read(folder: &Path) -> Result<Sources, String> {
    let mut sources = Sources::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        let entries =
            fs::read_dir(&next).map_err(|error| format!("{}: {error}", next.display()))?;
        for entry in entries {
            let path = entry.map_err(|error| format!("{}: {error}", next.display()))?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path)
                    .map_err(|error| format!("{}: {error}", path.display()))?;
                let below = path.strip_prefix(folder).unwrap_or(&path).to_path_buf();
                sources.insert(below, text);
            }
        }
    }
    Ok(sources)
}

/// One module of a crate. Its items lie in one file; an inline module shares its parent's file.
pub struct Module {
    /// Index into [`Crate::files`].
    pub file: usize,
    /// Index into [`Crate::modules`]; `None` for the crate's root.
    pub parent: Option<usize>,
    /// Child modules by name: indices into [`Crate::modules`].
    pub children: BTreeMap<String, usize>,
    /// Items without modules and without `#[cfg(test)]`.
    pub items: Vec<syn::Item>,
}

/// A crate without its tests: every module that is reached from the root file by `mod`.
#[derive(Default)]
pub struct Crate {
    /// Paths below the source folder.
    pub files: Vec<PathBuf>,
    /// The root is the first.
    pub modules: Vec<Module>,
}

impl Crate {
    /// Parses the root file (`lib.rs`, `main.rs`) and all modules below it.
    ///
    /// # Errors
    /// Says which file is missing or is not Rust.
    pub fn parse(sources: &Sources, root: &str) -> Result<Self, String> {
        let mut parsed = Self::default();
        parsed.add_file(sources, Path::new(root), Path::new(""), None)?;
        Ok(parsed)
    }

    /// Adds a file as a module; `folder` is where its child modules lie.
    fn add_file(
        &mut self,
        sources: &Sources,
        path: &Path,
        folder: &Path,
        parent: Option<usize>,
    ) -> Result<usize, String> {
        let text = sources.get(path).ok_or_else(|| format!("{} is missing", path.display()))?;
        let syntax =
            syn::parse_file(text).map_err(|error| format!("{}: {error}", path.display()))?;
        self.files.push(path.to_path_buf());
        self.add_module(sources, self.files.len() - 1, folder, parent, syntax.items)
    }

    fn add_module(
        &mut self,
        sources: &Sources,
        file: usize,
        folder: &Path,
        parent: Option<usize>,
        items: Vec<syn::Item>,
    ) -> Result<usize, String> {
        let this = self.modules.len();
        self.modules.push(Module { file, parent, children: BTreeMap::new(), items: Vec::new() });
        for item in items.into_iter().filter(|item| !is_test(attributes(item))) {
            let syn::Item::Mod(module) = item else {
                self.modules[this].items.push(item);
                continue;
            };
            let name = module.ident.to_string();
            let below = folder.join(&name);
            let child = if let Some((_, items)) = module.content {
                self.add_module(sources, file, &below, Some(this), items)?
            } else {
                let flat = folder.join(format!("{name}.rs"));
                let path = if sources.contains_key(&flat) { flat } else { below.join("mod.rs") };
                self.add_file(sources, &path, &below, Some(this))?
            };
            self.modules[this].children.insert(name, child);
        }
        Ok(this)
    }
}

/// Whether an item exists only in tests: `#[cfg(test)]` or `#[cfg(all(test, ..))]`.
pub fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let syn::Meta::List(list) = &attribute.meta else {
            return attribute.path().is_ident("test");
        };
        let tokens = list.tokens.to_string().replace(' ', "");
        list.path.is_ident("cfg") && (tokens == "test" || tokens.starts_with("all(test"))
    })
}

/// The attributes of an item of any kind.
pub fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Enum(item) => &item.attrs,
        syn::Item::ExternCrate(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Macro(item) => &item.attrs,
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Static(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        syn::Item::Trait(item) => &item.attrs,
        syn::Item::Type(item) => &item.attrs,
        syn::Item::Union(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        _ => &[],
    }
}
