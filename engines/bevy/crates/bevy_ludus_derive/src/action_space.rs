//! `#[derive(ActionSpace)]`.

use crate::field::{Field, Options, check_names, fields_of};
use proc_macro2::TokenStream;
use quote::quote;
use syn::{Data, DataEnum, DeriveInput, Error, Expr, Fields, LitInt, Result};

const MAX_CHOICES: u64 = 1 << 20;

/// Writes the implementation.
pub fn expand(input: &DeriveInput) -> Result<TokenStream> {
    match &input.data {
        Data::Enum(data) => expand_enum(input, data),
        _ => expand_struct(input),
    }
}

fn expand_struct(input: &DeriveInput) -> Result<TokenStream> {
    let fields = fields_of(input, "an action")?;
    check_names(&fields)?;
    let components = fields.iter().map(component).collect::<Result<Vec<_>>>()?;
    let reads = fields.iter().map(read);
    let name = &input.ident;
    let (generics, arguments, bounds) = input.generics.split_for_impl();
    Ok(quote! {
        impl #generics ::bevy_ludus::space::ActionSpace for #name #arguments #bounds {
            fn components() -> ::std::vec::Vec<::bevy_ludus::wire::ActionComponent> {
                ::std::vec![#(#components),*]
            }

            #[inline]
            fn read(row: &mut ::bevy_ludus::space::RowReader<'_>) -> Self {
                Self { #(#reads),* }
            }
        }
    })
}

fn component(field: &Field) -> Result<TokenStream> {
    let (name, options) = (&field.name, &field.options);
    let kind = match &options.n {
        Some(n) => {
            if options.low.is_some() || options.high.is_some() {
                return Err(Error::new(
                    n.span(),
                    "n is for a choice, low and high are for numbers",
                ));
            }
            let n = checked_n(n)?;
            quote! { ::bevy_ludus::wire::ActionKind::Discrete { n: #n } }
        }
        None => {
            let ty = &field.ty;
            let low = bound(options.low.as_ref(), -1.0);
            let high = bound(options.high.as_ref(), 1.0);
            quote! { <#ty as ::bevy_ludus::space::ActionPart>::kind(#low, #high) }
        }
    };
    Ok(quote! { ::bevy_ludus::space::component(#name, #kind) })
}

fn read(field: &Field) -> TokenStream {
    let (ident, ty) = (&field.ident, &field.ty);
    if field.options.n.is_some() {
        quote! { #ident: <#ty as ::bevy_ludus::space::Choice>::from_choice(row.choice()) }
    } else {
        quote! { #ident: <#ty as ::bevy_ludus::space::ActionPart>::read(row) }
    }
}

fn checked_n(n: &LitInt) -> Result<u64> {
    match n.base10_parse::<u64>() {
        Ok(value) if (1..=MAX_CHOICES).contains(&value) => Ok(value),
        _ => Err(Error::new(n.span(), format!("expected 1 to {MAX_CHOICES}"))),
    }
}

fn bound(value: Option<&Expr>, default: f64) -> TokenStream {
    match value {
        Some(value) => quote! { ::bevy_ludus::wire::Bound::from(#value) },
        None => quote! { ::bevy_ludus::wire::Bound::from(#default) },
    }
}

fn expand_enum(input: &DeriveInput, data: &DataEnum) -> Result<TokenStream> {
    if let Some(variant) = data
        .variants
        .iter()
        .find(|variant| variant.fields != Fields::Unit)
    {
        return Err(Error::new(
            variant.ident.span(),
            "a choice is a variant without fields",
        ));
    }
    let Some(first) = data.variants.first().map(|variant| &variant.ident) else {
        return Err(Error::new(
            input.ident.span(),
            "a choice needs at least one variant",
        ));
    };
    let options = Options::read(&input.attrs)?;
    let label = options.name.unwrap_or_else(|| "action".to_owned());
    let n = data.variants.len() as u64;
    let numbers = 1_i64..;
    let others = data.variants.iter().skip(1).map(|variant| &variant.ident);
    let arms = numbers
        .zip(others)
        .map(|(number, ident)| quote! { #number => Self::#ident, });
    let name = &input.ident;
    Ok(quote! {
        impl ::bevy_ludus::space::ActionPart for #name {
            fn kind(
                _low: ::bevy_ludus::wire::Bound,
                _high: ::bevy_ludus::wire::Bound,
            ) -> ::bevy_ludus::wire::ActionKind {
                ::bevy_ludus::wire::ActionKind::Discrete { n: #n }
            }

            #[inline]
            fn read(row: &mut ::bevy_ludus::space::RowReader<'_>) -> Self {
                match row.choice() {
                    #(#arms)*
                    _ => Self::#first,
                }
            }
        }

        impl ::bevy_ludus::space::ActionSpace for #name {
            fn components() -> ::std::vec::Vec<::bevy_ludus::wire::ActionComponent> {
                let bound = ::bevy_ludus::wire::Bound::from(0.0);
                let kind = <Self as ::bevy_ludus::space::ActionPart>::kind(bound.clone(), bound);
                ::std::vec![::bevy_ludus::space::component(#label, kind)]
            }

            #[inline]
            fn read(row: &mut ::bevy_ludus::space::RowReader<'_>) -> Self {
                <Self as ::bevy_ludus::space::ActionPart>::read(row)
            }
        }
    })
}
