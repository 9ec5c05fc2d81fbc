//! Fields of a struct and their attributes.

use syn::spanned::Spanned;
use syn::{Attribute, Data, DeriveInput, Error, Expr, Fields, Ident, LitInt, LitStr, Result, Type};

/// What `#[ludus(…)]` says.
#[derive(Default)]
pub struct Options {
    pub name: Option<String>,
    pub low: Option<Expr>,
    pub high: Option<Expr>,
    pub n: Option<LitInt>,
}

impl Options {
    /// Reads all attributes.
    pub fn read(attributes: &[Attribute]) -> Result<Self> {
        let mut options = Self::default();
        for attribute in attributes
            .iter()
            .filter(|attribute| attribute.path().is_ident("ludus"))
        {
            attribute.parse_nested_meta(|meta| {
                let key = meta
                    .path
                    .get_ident()
                    .map(ToString::to_string)
                    .unwrap_or_default();
                match key.as_str() {
                    "name" => options.name = Some(checked_name(&meta.value()?.parse()?)?),
                    "low" => options.low = Some(meta.value()?.parse()?),
                    "high" => options.high = Some(meta.value()?.parse()?),
                    "n" => options.n = Some(meta.value()?.parse()?),
                    _ => return Err(meta.error("expected name, low, high or n")),
                }
                Ok(())
            })?;
        }
        Ok(options)
    }
}

fn checked_name(name: &LitStr) -> Result<String> {
    let length = name.value().chars().count();
    if (1..=128).contains(&length) {
        return Ok(name.value());
    }
    Err(Error::new(name.span(), "names have 1 to 128 characters"))
}

/// One field.
pub struct Field {
    pub ident: Ident,
    pub ty: Type,
    pub name: String,
    pub options: Options,
}

/// Returns the named fields of a struct.
pub fn fields_of(input: &DeriveInput, purpose: &str) -> Result<Vec<Field>> {
    let refuse = |what: &str| Err(Error::new(input.ident.span(), format!("{purpose} {what}")));
    let Data::Struct(data) = &input.data else {
        return refuse("is a struct with named fields");
    };
    let Fields::Named(named) = &data.fields else {
        return refuse("needs named fields: their names become names of the protocol");
    };
    if named.named.is_empty() {
        return refuse("needs at least one field");
    }
    if named.named.len() > 64 {
        return refuse("has at most 64 fields");
    }
    named.named.iter().map(read_field).collect()
}

fn read_field(field: &syn::Field) -> Result<Field> {
    let Some(ident) = field.ident.clone() else {
        return Err(Error::new(field.span(), "the field needs a name"));
    };
    let options = Options::read(&field.attrs)?;
    let name = options.name.clone().unwrap_or_else(|| ident.to_string());
    Ok(Field {
        ident,
        ty: field.ty.clone(),
        name,
        options,
    })
}

/// Refuses two fields with one name.
pub fn check_names(fields: &[Field]) -> Result<()> {
    for (index, field) in fields.iter().enumerate() {
        if fields[..index].iter().any(|other| other.name == field.name) {
            let text = format!("the name \"{}\" comes twice", field.name);
            return Err(Error::new(field.ident.span(), text));
        }
    }
    Ok(())
}
