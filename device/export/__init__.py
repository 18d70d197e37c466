"""Exchange files of the trade: each module turns one ``Inspection`` into one format, without a store, a clock or a page."""
