"""report.html: one page that plays the recorded gaits and shows all that was measured, with nothing to install."""
