"""Pictures of what the languages describe. Written without any library, since what is drawn is small."""
