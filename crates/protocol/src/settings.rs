//! Settings of a game, as fields of several structs.

/// Defines a struct with the settings of `swarmbench_engine::for_each_setting` in the place of `..settings`, and its
/// conversions. The struct is written as any other, after one of these words:
///
/// - `partial`: each setting is an `Option`. `over(usual)` fills in those that are `None`; from [`Settings`].
/// - `complete`: unchecked values of all settings. From [`Settings`] and back.
/// - `checked`: the types of checked settings. From a [`Config`], and back to [`Settings`].
///
/// Conversions from settings leave the struct's other fields at their defaults. The struct has a field `control`, optional in
/// partial structs; if it follows `max_round` on the wire, it is written `..settings { pub control: String }`. The settings
/// end with `answer_reader`, which old journals and suites lack.
///
/// [`Config`]: swarmbench_engine::Config
/// [`Settings`]: swarmbench_engine::Settings
#[macro_export]
macro_rules! game_settings {
    (
        $form:ident
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($(#[$before_meta:meta])* pub $before:ident: $before_type:ty,)*
            ..settings $({ $(#[$inner_meta:meta])* pub $inner:ident: $inner_type:ty })?,
            $($(#[$after_meta:meta])* pub $after:ident: $after_type:ty,)*
        }
    ) => {
        swarmbench_engine::for_each_setting! {
            $crate::game_settings,
            {
                $form $name { $(#[$meta])* }
                { $($(#[$before_meta])* pub $before: $before_type,)* }
                { $($(#[$after_meta])* pub $after: $after_type,)* }
                { $($before)* $($inner)? $($after)* }
            },
            { $($(#[$inner_meta])* pub $inner: $inner_type,)? }
        }
    };

    (
        {
            partial $name:ident { $($meta:tt)* } { $($before:tt)* } { $($after:tt)* } { $($other:ident)* }
        }
        $([$(
            $(#[doc = $doc:literal])* $(#[serde $later:tt])?
            $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
        )*] { $($inner:tt)* })*
    ) => {
        $($meta)*
        pub struct $name {
            $($before)*
            $(
                $(
                    $(#[doc = $doc])*
                    #[cfg_attr(feature = "openapi", schema(default = $usual, minimum = $least, maximum = $most))]
                    pub $setting: Option<$asked>,
                )*
                $($inner)*
            )*
            /// Reader of language models' answers: `last-marker`, `first-marker` or `json`.
            #[cfg_attr(feature = "openapi", schema(default = "last-marker"))]
            pub answer_reader: Option<String>,
            $($after)*
        }

        impl $name {
            /// Settings of the engine: these, and those of `usual` for the ones that are `None`.
            #[must_use]
            pub fn over(&self, usual: swarmbench_engine::Settings) -> swarmbench_engine::Settings {
                swarmbench_engine::Settings {
                    control: self.control.clone().unwrap_or(usual.control),
                    $($($setting: self.$setting.unwrap_or(usual.$setting),)*)*
                    answer_reader: self.answer_reader.clone().unwrap_or(usual.answer_reader),
                    ..usual
                }
            }
        }

        impl From<&swarmbench_engine::Settings> for $name {
            fn from(settings: &swarmbench_engine::Settings) -> Self {
                let mut all = Self {
                    $($other: Default::default(),)*
                    $($($setting: Some(settings.$setting),)*)*
                    answer_reader: None,
                };
                all.control = Some(settings.control.clone());
                all.answer_reader = Some(settings.answer_reader.clone());
                all
            }
        }
    };

    (
        { complete $name:ident $meta:tt $before:tt $after:tt { $($other:ident)* } }
        $([$(
            $(#[doc = $doc:literal])* $(#[serde $later:tt])?
            $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
        )*] $inner:tt)*
    ) => {
        $crate::game_settings! {
            @whole $name $meta $before $after
            $([$($(#[doc = $doc])* $(#[serde $later])? $setting: $asked;)*] $inner)*
        }

        impl From<&swarmbench_engine::Settings> for $name {
            fn from(settings: &swarmbench_engine::Settings) -> Self {
                let mut all = Self {
                    $($other: Default::default(),)*
                    $($($setting: settings.$setting,)*)*
                    answer_reader: String::new(),
                };
                all.control = settings.control.clone();
                all.answer_reader = settings.answer_reader.clone();
                all
            }
        }
    };

    (
        { checked $name:ident $meta:tt $before:tt $after:tt { $($other:ident)* } }
        $([$(
            $(#[doc = $doc:literal])* $(#[serde $later:tt])?
            $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
        )*] $inner:tt)*
    ) => {
        $crate::game_settings! {
            @whole $name $meta $before $after
            $([$($(#[doc = $doc])* $(#[serde $later])? $setting: $checked;)*] $inner)*
        }

        impl From<&swarmbench_engine::Config> for $name {
            fn from(config: &swarmbench_engine::Config) -> Self {
                let settings = config.settings();
                let mut all = Self {
                    $($other: Default::default(),)*
                    $($($setting: settings.$setting.try_into().expect("it was checked"),)*)*
                    answer_reader: String::new(),
                };
                all.control = settings.control;
                all.answer_reader = settings.answer_reader;
                all
            }
        }
    };

    (
        @whole $name:ident { $($meta:tt)* } { $($before:tt)* } { $($after:tt)* }
        $([$($(#[$setting_meta:meta])* $setting:ident: $type:ident;)*] { $($inner:tt)* })*
    ) => {
        $($meta)*
        pub struct $name {
            $($before)*
            $(
                $($(#[$setting_meta])* pub $setting: $type,)*
                $($inner)*
            )*
            /// Reader of language models' answers, `last-marker`, `first-marker` or `json`; left out if it is `last-marker`.
            #[serde(
                default = "swarmbench_engine::AnswerReader::usual",
                skip_serializing_if = "swarmbench_engine::AnswerReader::is_usual"
            )]
            pub answer_reader: String,
            $($after)*
        }

        impl From<&$name> for swarmbench_engine::Settings {
            fn from(from: &$name) -> Self {
                Self {
                    control: from.control.clone(),
                    $($($setting: from.$setting.into(),)*)*
                    answer_reader: from.answer_reader.clone(),
                    ..Self::default()
                }
            }
        }
    };
}
