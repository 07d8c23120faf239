(define-derived-mode robocomp-mode prog-mode "RoboComp"
  "The languages of robot components."
  (modify-syntax-entry ?/ ". 124b")
  (modify-syntax-entry ?* ". 23")
  (modify-syntax-entry ?\n "> b")
  (setq-local comment-start "// ")
  (setq-local comment-end ""))

(add-to-list 'auto-mode-alist '("\\.\\(idsl\\|cdsl\\|pdsl\\|ddsl\\|smdsl\\)\\'" . robocomp-mode))

(with-eval-after-load 'eglot
  (add-to-list 'eglot-server-programs
               '(robocomp-mode . ("rc" "lsp" :initializationOptions (:include ["interfaces"])))))

(add-hook 'robocomp-mode-hook #'eglot-ensure)
