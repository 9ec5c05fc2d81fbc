//! What the macros refuse, and in which words.

use crate::{action_space, observation_space};
use syn::{DeriveInput, parse_quote};

fn refused(result: syn::Result<proc_macro2::TokenStream>) -> String {
    result.expect_err("a mistake").to_string()
}

fn is_refused_as_act(input: &DeriveInput, expected: &str) {
    let text = refused(action_space::expand(input));
    assert!(text.contains(expected), "{text}");
}

fn is_refused_as_observation(input: &DeriveInput, expected: &str) {
    let text = refused(observation_space::expand(input));
    assert!(text.contains(expected), "{text}");
}

#[test]
fn counts_of_alternatives_are_checked() {
    let none: DeriveInput = parse_quote! { struct A { #[ludus(n = 0)] weapon: u8 } };
    is_refused_as_act(&none, "expected 1 to 1048576");
    let many: DeriveInput = parse_quote! { struct A { #[ludus(n = 1048577)] weapon: u32 } };
    is_refused_as_act(&many, "expected 1 to 1048576");
    let both: DeriveInput = parse_quote! { struct A { #[ludus(n = 2, low = 0.0)] weapon: u8 } };
    is_refused_as_act(&both, "low and high are for numbers");
    let seen: DeriveInput = parse_quote! { struct O { #[ludus(n = 2)] health: u8 } };
    is_refused_as_observation(&seen, "n is for actions");
}

#[test]
fn attributes_and_names_are_checked() {
    let misspelt: DeriveInput = parse_quote! { struct O { #[ludus(lowest = 0.0)] health: f32 } };
    is_refused_as_observation(&misspelt, "expected name, low, high or n");
    let twice: DeriveInput = parse_quote! { struct O { #[ludus(name = "b")] a: f32, b: f32 } };
    is_refused_as_observation(&twice, "the name \"b\" comes twice");
    let empty: DeriveInput = parse_quote! { struct O { #[ludus(name = "")] a: f32 } };
    is_refused_as_observation(&empty, "1 to 128 characters");
}

#[test]
fn only_structs_with_named_fields_and_plain_enums_serve() {
    let tuple: DeriveInput = parse_quote! { struct O(f32); };
    is_refused_as_observation(&tuple, "an observation needs named fields");
    is_refused_as_act(&tuple, "an action needs named fields");
    let nothing: DeriveInput = parse_quote! { struct O {} };
    is_refused_as_observation(&nothing, "at least one field");
    let choice: DeriveInput = parse_quote! { enum O { A, B } };
    is_refused_as_observation(&choice, "is a struct with named fields");
    let filled: DeriveInput = parse_quote! { enum A { Stay, Go(f32) } };
    is_refused_as_act(&filled, "a variant without fields");
    let bare: DeriveInput = parse_quote! { enum A {} };
    is_refused_as_act(&bare, "at least one variant");
}
