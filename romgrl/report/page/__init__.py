"""report.html: one page that plays recorded gaits and shows all that was measured, with nothing to install."""
