//! Which file names items of which other file.
//!
//! A path counts as an import of the file that declares its last module: `crate::a::b::Item` imports
//! `a/b.rs`. A name that `a/mod.rs` re-exports counts as an import of `a/mod.rs`. `mod x;` alone is no
//! import, and neither is a visibility (`pub(in crate::a)`).

use crate::source::{Crate, is_test};
use proc_macro2::{TokenStream, TokenTree};
use std::collections::BTreeMap;
use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};

/// One import: `from` names `path`, which lies in `to`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Import {
    /// Index into [`Crate::files`].
    pub from: usize,
    /// Index into [`Crate::files`], never `from`.
    pub to: usize,
    /// Line in `from`, from 1.
    pub line: usize,
    /// The path as written.
    pub path: String,
}

/// How many `use` aliases may point at each other before a name is given up as unresolvable.
const MAX_ALIASES: usize = 16;

/// Resolves paths in a crate.
pub struct Resolver<'a> {
    parsed: &'a Crate,
    /// For each module, the names that its `use` items bring in, with the paths that they stand for.
    aliases: Vec<BTreeMap<String, Vec<String>>>,
}

impl<'a> Resolver<'a> {
    /// Collects the `use` items of every module.
    pub fn new(parsed: &'a Crate) -> Self {
        let aliases = parsed.modules.iter().map(|module| {
            let mut names = Names::default();
            module.items.iter().for_each(|item| names.visit_item(item));
            let used = names.found.into_iter().filter(|name| name.is_use);
            used.filter_map(|name| Some((name.alias?, name.path))).collect()
        });
        Self { parsed, aliases: aliases.collect() }
    }

    /// The module in which a path ends and how many of its segments lead there; `None` if the path leads
    /// out of the crate or names a local item.
    pub fn module_of(&self, module: usize, path: &[String]) -> Option<(usize, usize)> {
        self.walk(module, path, MAX_ALIASES)
    }

    fn walk(&self, module: usize, path: &[String], aliases_left: usize) -> Option<(usize, usize)> {
        let modules = &self.parsed.modules;
        let first = path.first()?;
        let mut at = match first.as_str() {
            "crate" => 0,
            "self" => module,
            "super" => modules[module].parent?,
            name => match modules[module].children.get(name) {
                Some(&child) => child,
                None => self.through_alias(module, name, aliases_left)?,
            },
        };
        let mut taken = 1;
        for name in &path[1..] {
            at = match name.as_str() {
                "super" => modules[at].parent?,
                "self" => at,
                name => match modules[at].children.get(name) {
                    Some(&child) => child,
                    None => break,
                },
            };
            taken += 1;
        }
        Some((at, taken))
    }

    /// The module that an alias stands for, or the module of the item that it stands for.
    fn through_alias(&self, module: usize, name: &str, aliases_left: usize) -> Option<usize> {
        let target = self.aliases[module].get(name)?;
        if aliases_left == 0 || target.first().is_some_and(|first| first == name) {
            return None;
        }
        self.walk(module, target, aliases_left - 1).map(|(at, _)| at)
    }

    /// The file and name of the type that a path names, following re-exports; for an external type the
    /// file is `None`.
    pub fn definition(&self, module: usize, path: &[String]) -> (Option<usize>, String) {
        let (mut module, mut path) = (module, path.to_vec());
        for _ in 0..MAX_ALIASES {
            let name = path.last().cloned().unwrap_or_default();
            let at =
                if path.len() == 1 { Some((module, 0)) } else { self.module_of(module, &path) };
            let Some((at, _)) = at else { return (None, path.join("::")) };
            match self.aliases[at].get(&name) {
                Some(target) if *target != path => (module, path) = (at, target.clone()),
                _ => return (Some(self.parsed.modules[at].file), name),
            }
        }
        (None, path.join("::"))
    }
}

/// All imports between files, sorted, without duplicates in one line.
pub fn imports(parsed: &Crate) -> Vec<Import> {
    let resolver = Resolver::new(parsed);
    let mut found = Vec::new();
    for (at, module) in parsed.modules.iter().enumerate() {
        let mut names = Names::default();
        module.items.iter().for_each(|item| names.visit_item(item));
        for name in names.found {
            let Some((target, _)) = resolver.module_of(at, &name.path) else { continue };
            let (from, to) = (module.file, parsed.modules[target].file);
            if from != to {
                found.push(Import { from, to, line: name.line, path: name.path.join("::") });
            }
        }
    }
    found.sort();
    found.dedup();
    found
}

/// A path that stands in the source.
struct Name {
    path: Vec<String>,
    line: usize,
    is_use: bool,
    /// The name that a `use` brings in; `None` for globs and for paths in code.
    alias: Option<String>,
}

/// Collects the paths of items that are no tests.
#[derive(Default)]
struct Names {
    found: Vec<Name>,
}

impl Names {
    fn add_use(&mut self, tree: &syn::UseTree, prefix: &[String]) {
        let line = tree.span().start().line;
        let with = |ident: &syn::Ident| {
            let mut path = prefix.to_vec();
            path.push(ident.to_string());
            path
        };
        let (path, alias) = match tree {
            syn::UseTree::Path(tree) => return self.add_use(&tree.tree, &with(&tree.ident)),
            syn::UseTree::Group(group) => {
                return group.items.iter().for_each(|item| self.add_use(item, prefix));
            }
            syn::UseTree::Glob(_) => (prefix.to_vec(), None),
            syn::UseTree::Name(name) if name.ident == "self" => {
                (prefix.to_vec(), prefix.last().cloned())
            }
            syn::UseTree::Name(name) => (with(&name.ident), Some(name.ident.to_string())),
            syn::UseTree::Rename(name) if name.ident == "self" => {
                (prefix.to_vec(), Some(name.rename.to_string()))
            }
            syn::UseTree::Rename(name) => (with(&name.ident), Some(name.rename.to_string())),
        };
        self.found.push(Name { path, line, is_use: true, alias });
    }

    fn add_path(&mut self, path: Vec<String>, line: usize) {
        // A single name is local or came by a `use`, which is counted already.
        if path.len() > 1 {
            self.found.push(Name { path, line, is_use: false, alias: None });
        }
    }

    /// Finds `a::b::c` in a macro's input, which is no syntax tree.
    fn add_tokens(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut line = 0;
        let mut colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(ident) => {
                    if colons != 2 || path.is_empty() {
                        self.add_path(std::mem::take(&mut path), line);
                        line = ident.span().start().line;
                    }
                    path.push(ident.to_string());
                    colons = 0;
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' => colons += 1,
                other => {
                    self.add_path(std::mem::take(&mut path), line);
                    colons = 0;
                    if let TokenTree::Group(group) = other {
                        self.add_tokens(group.stream());
                    }
                }
            }
        }
        self.add_path(path, line);
    }
}

impl<'ast> Visit<'ast> for Names {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_test(crate::source::attributes(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_test(&item.attrs) {
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if item.leading_colon.is_none() {
            self.add_use(&item.tree, &[]);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let segments = path.segments.iter().map(|segment| segment.ident.to_string());
            self.add_path(segments.collect(), path.span().start().line);
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        visit::visit_macro(self, call);
        self.add_tokens(call.tokens.clone());
    }

    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
}
